"""A square in even light, with and without roulette: the mean is the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from common.environment import constant
from common.numerics.transforms import pose_looking_at
from common.scene import Material, Scene
from common.view.camera import Orthographic, View
from tests.support.scenes import quad_scene
from tools.exercises.checking import Given

SEEN = View(pose_looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), Orthographic(0.5, 0.1, 9.0))


def check(given: Given) -> None:
    """For a dark and for a bright material; roulette begins with the first reflection."""
    knobs = {
        "path_tracer": True,
        "path_samples": 256,
        "path_strategy": "bsdf",
        "environment_size": 32,
        "ambient": 0.0,
    }
    for base in (0.2, 0.8):
        with given.open(lit(base), (12, 12), ("color_linear",), **knobs) as renderer:
            without, with_ = (mean(renderer, first) for first in (64, 0))
        given.silent()
        given.need(without > 0.0, "Nothing is lit.")
        given.need(
            abs(with_ / without - 1.0) < 0.04,
            f"A square of base colour {base:g} shows {without:.3f} nits without roulette, and {with_:.3f} with it.",
        )


def mean(renderer: Any, first: int) -> float:
    """Return the light of all pixels, where roulette begins after so many reflections."""
    renderer.settings.paths.path_roulette = first
    return float(renderer.render(SEEN).image("color_linear").astype(np.float64).mean())


def lit(base: float) -> Scene:
    """Return a square in light of 1 nit from everywhere."""
    grey = Material(base_color=(base, base, base, 1.0), metallic=0.0, roughness=0.9)
    return replace(quad_scene(grey, matrices=(np.diag((4.0, 4.0, 4.0, 1.0)),)), environment=constant(1.0))
