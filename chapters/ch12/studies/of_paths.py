"""What studies of the path tracer share: the chapter's renderer with the settings of a study, and scenes of squares."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.contract import check_arguments
from common.numerics.transforms import pose_looking_at
from common.scene import MESH_DTYPE, Instances, Material, Nodes, Scene, SceneCamera
from common.settings import knob

from ..frames.frame import OUTPUTS
from ..paths.settings import PathSettings
from ..renderer import Renderer
from ..scene.settings import SceneSettings
from ..settings import Settings as ChapterSettings

Square = tuple[NDArray[np.float64], Material]
"""The matrix that places the square from -1 to 1, which faces +z, and its material."""


@dataclass
class TracedSettings(PathSettings):
    """How paths are sampled: traced from the beginning."""

    path_tracer: bool = knob(True, "whether the picture is traced by paths, in place of all that is drawn")


@dataclass
class OwnLight(SceneSettings):
    """The scene as it is: nothing is lit but by what emits."""

    ambient: float = knob(
        0.0, "light that arrives from every direction alike", unit="nits", minimum=0, maximum=1e9
    )
    default_light: bool = knob(
        False, "whether a scene without lights gets one that shines from behind the camera"
    )


class PathStudy(Renderer):
    """Draws what the chapter draws with its path tracer."""

    KIND: type = ChapterSettings
    """The settings of the study."""

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Any = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        **more: Any,
    ) -> None:
        settings, outputs = check_arguments(scene, settings, self.KIND, outputs, OUTPUTS)
        super().__init__(scene, size, settings, without, outputs, **more)


def square_at(center: ArrayLike, normal: ArrayLike, half: tuple[float, float]) -> NDArray[np.float64]:
    """Return the matrix (4, 4) of a square that faces along a normal, with half of its width and height in metres."""
    at = np.asarray(center, np.float64)
    return pose_looking_at(tuple(at), tuple(at - np.asarray(normal, np.float64))) @ np.diag((*half, 1.0, 1.0))


def squares(
    name: str,
    placed: Sequence[Square],
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    yfov: float,
    ev100: float,
) -> Scene:
    """Return a scene of squares, each an instance of a mesh of its own, and a camera; `yfov` in radians."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    count = len(placed)
    meshes = np.zeros(count, MESH_DTYPE)
    meshes["index_count"], meshes["vertex_count"], meshes["material"] = 6, 4, np.arange(count)
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
    numbers = np.arange(count, dtype=np.int32)
    nodes = np.stack([*(matrix for matrix, _ in placed), pose_looking_at(eye, target)])
    points = np.concatenate([corners @ matrix[:3, :3].T + matrix[:3, 3] for matrix, _ in placed])
    scene = Scene(
        name=name,
        path=None,
        positions=corners,
        normals=np.tile(np.array((0, 0, 1), np.float32), (4, 1)),
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (4, 1)),
        uv0=np.zeros((4, 2), np.float32),
        uv1=None,
        colors=None,
        indices=np.array([0, 1, 2, 0, 2, 3], np.uint32),
        meshes=meshes,
        mesh_names=[material.name for _, material in placed],
        materials=[material for _, material in placed],
        images=[],
        nodes=Nodes(
            parent=np.full(len(nodes), -1, np.int32),
            translation=np.zeros((len(nodes), 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (len(nodes), 1)),
            scale=np.ones((len(nodes), 3)),
            matrix=nodes,
            has_matrix=np.ones(len(nodes), bool),
            names=[*(material.name for _, material in placed), "camera"],
        ),
        instances=Instances(numbers, numbers.copy()),
        lights=[],
        cameras=[SceneCamera("front", count, yfov=yfov, ev100=ev100)],
        animations=[],
        deformations=[],
    )
    scene.bounds = np.stack([points.min(axis=0), points.max(axis=0)])
    return scene
