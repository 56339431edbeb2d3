"""What studies with rays share and no API has a part in: the eye, pixels, and a scene that is nothing but a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.stage import Work
from common.numerics.transforms import pose_looking_at
from common.scene import Nodes, Scene, SceneCamera
from common.scene.primitive import nothing
from common.view.camera import Orthographic, View

EYE = np.dtype(
    [("view_from_clip", np.float32, (4, 4)), ("world_from_view", np.float32, (4, 4)), ("size", np.uint32, 4)]
)
"""The block `Eye_` of eye.glsl, matrices by columns."""

PIXEL = np.dtype([("color", np.float32, 4), ("what", np.uint32, 4)])
"""What a ray has found: linear colour and t, and numbers of the study's own."""

SHADERS = ("post/fullscreen.vert", "studies/seen.frag")
"""The draw that shows pixels."""

COUNTS = 4
"""Counters of a frame, words."""


@dataclass
class RayWork(Work):
    """What a frame did, as far as it is known without the GPU."""

    rays: int = 0


def work(size: tuple[int, int]) -> RayWork:
    """Return the counters of a frame with a ray for each pixel."""
    return RayWork(draws=1, triangles=1, rays=size[0] * size[1])


def eye_of(view: View, size: tuple[int, int], number: int = 0) -> np.ndarray:
    """Return the block of a view, () EYE; `number` is the study's own."""
    block = np.zeros((), EYE)
    block["view_from_clip"] = np.linalg.inv(view.clip_from_view(size[0] / size[1])).T
    block["world_from_view"] = view.world_from_view.T
    block["size"] = (*size, isinstance(view.projection, Orthographic), number)
    return block


def camera_scene(name: str, eye: Sequence[float], target: Sequence[float], yfov: float) -> Scene:
    """Return a scene with a camera and nothing else; `yfov` in radians."""
    nodes = Nodes(
        parent=np.array([-1], np.int32),
        translation=np.zeros((1, 3)),
        rotation=np.array([(0.0, 0.0, 0.0, 1.0)]),
        scale=np.ones((1, 3)),
        matrix=pose_looking_at(tuple(eye), tuple(target))[None],
        has_matrix=np.ones(1, bool),
        names=["camera"],
    )
    return replace(nothing(name), nodes=nodes, cameras=[SceneCamera(name, 0, yfov=yfov)])
