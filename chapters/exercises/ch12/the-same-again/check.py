"""A square under a lamp: frames have paths of their own, and their mean comes nearer to the truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Material, Scene
from common.view.camera import Orthographic, View
from tests.support.scenes import quad_scene
from tests.support.shadows import placed
from tools.exercises.checking import Given

ABOVE = View(pose_looking_at((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), (0, 0, -1)), Orthographic(0.5, 0.1, 9.0))
FRAMES = 16


def check(given: Given) -> None:
    """The mean of frames against that of one frame with many paths, and frames alone against each other."""
    knobs = {
        "path_tracer": True,
        "path_bounces": 1,
        "path_strategy": "bsdf",
        "path_filter": "centre",
        "ambient": 0.0,
    }
    with given.open(under_a_lamp(), (12, 12), ("color_linear",), **knobs) as renderer:
        first = light(renderer)
        for _ in range(FRAMES - 1):
            mean = light(renderer)
        renderer.settings.paths.path_samples = 1024
        renderer.settings.paths.path_seed = 1
        many = light(renderer)
    given.silent()
    given.need(
        not np.array_equal(mean, first),
        f"After {FRAMES} frames the picture is still that of the first one.",
    )
    one, all_ = (float(np.sqrt(((shown - many) ** 2).mean())) for shown in (first, mean))
    given.need(
        all_ < 0.4 * one,
        f"{FRAMES} frames have {all_ / one:.2f} of the error of one frame; independent paths have a quarter.",
    )
    given.need(0.8 < mean.mean() / many.mean() < 1.2, "The mean of the frames is not the light of the floor.")


def light(renderer: Any) -> np.ndarray:
    """Return the light of the next frame."""
    pixels: np.ndarray = renderer.render(ABOVE).image("color_linear").astype(np.float64)
    return pixels


def under_a_lamp() -> Scene:
    """Return a floor and a large square above it that emits light downwards."""
    grey = Material(base_color=(0.6, 0.6, 0.6, 1.0), metallic=0.0, roughness=1.0)
    lamp = Material(base_color=(0.0, 0.0, 0.0, 1.0), metallic=1.0, roughness=1.0, emissive=(2.0, 2.0, 2.0))
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0, 1, 0), (1.6, 1.6), (0, -1, 0)))
    return quad_scene(materials=(grey, lamp), matrices=squares, instance_materials=(0, 1))
