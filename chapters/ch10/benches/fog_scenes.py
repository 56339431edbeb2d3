"""What the bench of fog draws: a ground in haze with a lamp, scenes in which fog is all that is seen, settings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.reports.benches import Subject, moved_view
from common.scene import FogBox, Light, Material, Medium, Nodes, Scene, SceneCamera
from common.scene.primitive import scene_of
from common.settings import knobs, preset, replaced
from common.view.camera import View

Vector = tuple[float, float, float]

EYE, TARGET = (0.0, 1.6, 8.0), (0.0, 0.9, 0.0)
"""The camera over the ground, in metres."""

BEHIND, AHEAD = (0.8, 3.0, 11.0), (0.9, 1.5, 2.0)
"""Lamps: behind the camera no froxel is large against the distance to it; ahead, the nearest ones are."""

CANDELA = 500.0

HAZE = Medium(extinction=0.06, albedo=(0.9, 0.9, 0.9))
"""A homogeneous medium: a third of the light is left behind 18 metres of it."""

LAYER = Medium(boxes=(FogBox((0.0, 0.5, 0.0), (8.0, 0.5, 8.0), 0.15, (0.95, 0.95, 0.95)),))
"""A metre of mist on the ground. Rays meet its upper side at a flat angle, each some slices later than the one below:
the light over the ground is a ramp with the steps of slices in it."""

AROUND = 3.0
"""Nits from everywhere that light the ramp, which has no lamp."""

BLACK = Material(base_color=(0.0, 0.0, 0.0, 1.0), metallic=0.0, roughness=1.0)

DRIFT = 1e-3
"""Steps of `moved_view` by which the camera drifts in a frame: 1e-6 length scales."""


def ground(medium: Medium, lamp: Vector) -> Scene:
    """Return a black ground of 16x16 metres in a medium, with a lamp and a camera."""
    corners = np.array([(-8, 0, 8), (8, 0, 8), (8, 0, -8), (-8, 0, -8)], np.float64)
    uv, up = np.zeros((4, 2)), np.tile((0.0, 1.0, 0.0), (4, 1))
    scene = scene_of("ground", corners, up, uv, [0, 1, 2, 0, 2, 3], BLACK, [])
    at = np.eye(4)
    at[:3, 3] = lamp
    poses = np.stack([np.eye(4), at, pose_looking_at(EYE, TARGET)])
    count = len(poses)
    nodes = Nodes(
        parent=np.full(count, -1, np.int32),
        translation=np.zeros((count, 3)),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)),
        scale=np.ones((count, 3)),
        matrix=poses,
        has_matrix=np.ones(count, bool),
        names=["ground", "lamp", "camera"],
    )
    light = Light("point", 1, intensity=CANDELA)
    camera = SceneCamera("haze", 2, yfov=np.radians(55.0), near=0.05, ev100=4.0)
    return replace(scene, nodes=nodes, lights=[light], cameras=[camera], ambient=0.0, medium=medium)


def ramp() -> Scene:
    """Return the ground in its layer of mist under light from everywhere."""
    scene = ground(LAYER, BEHIND)
    return replace(scene, lights=[], ambient=AROUND, cameras=[replace(scene.cameras[0], ev100=1.0)])


def with_black_surfaces(scene: Scene) -> Scene:
    """Return a scene at rest whose surfaces send next to no light, so that fog is what is seen.

    Blended surfaces are not there: they have no depth. Holes of others are closed: rays do not know where they are.
    """
    blended = np.array([material.alpha_mode == "blend" for material in scene.materials], bool)
    gone = blended[scene.meshes["material"][scene.instances.mesh]]
    instances = replace(scene.instances, visible=scene.instances.visible & ~gone)
    black = [
        replace(BLACK, name=one.name, unlit=one.unlit, double_sided=one.double_sided)
        for one in scene.materials
    ]
    return replace(scene, materials=black, instances=instances, images=[], animations=[])


def settings_of(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: those of `medium` with all digits, and without what moves."""
    exact = {
        "graph": "deferred",
        "color_format": "rgba32f",
        "msaa": 1,
        "lod_pixels": 0.0,
        "cloth": False,
        "background": 0.0,
        "default_light": False,
        "fog_dither": False,
        **values,
    }
    known = knobs(subject.settings_class)
    settings = preset(subject.settings_class, "medium")
    return replaced(settings, **{name: value for name, value in exact.items() if name in known})


def drifting(view: View, scene: Scene) -> Iterator[View]:
    """Yield views that no two frames share."""
    number = 0
    while True:
        number += 1
        yield moved_view(view, scene, number * DRIFT)
