"""A square in even light, by each strategy: all show what the square reflects, which is less than arrives."""

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

NITS, BASE = 2.0, 0.6
SEEN = View(pose_looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), Orthographic(0.5, 0.1, 9.0))


def check(given: Given) -> None:
    """Each strategy alone, with the mean of all pixels."""
    knobs = {"path_tracer": True, "path_samples": 128, "environment_size": 32, "ambient": 0.0}
    with given.open(lit(), (12, 12), ("color_linear",), **knobs) as renderer:
        seen = {name: mean(renderer, name) for name in ("bsdf", "lights", "mis")}
    given.silent()
    for name, light in seen.items():
        given.need(
            light < NITS,
            f"With path_strategy={name} the square reflects {light:.2f} nits, and {NITS:g} arrive from everywhere.",
        )
        given.need(
            abs(light / seen["bsdf"] - 1.0) < 0.03,
            f"With path_strategy={name} the square shows {light:.3f} nits, and not {seen['bsdf']:.3f}.",
        )
    given.need(seen["bsdf"] > 0.9 * BASE * NITS, f"Reflected rays alone find {seen['bsdf']:.3f} nits.")


def mean(renderer: Any, strategy: str) -> float:
    """Return the light of all pixels with a strategy."""
    renderer.settings.paths.path_strategy = strategy
    return float(renderer.render(SEEN).image("color_linear").astype(np.float64).mean())


def lit() -> Scene:
    """Return a grey square in light from everywhere."""
    grey = Material(base_color=(BASE, BASE, BASE, 1.0), metallic=0.0, roughness=0.9)
    return replace(quad_scene(grey, matrices=(np.diag((4.0, 4.0, 4.0, 1.0)),)), environment=constant(NITS))
