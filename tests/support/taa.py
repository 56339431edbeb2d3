"""Scenes and renderers for tests of temporal anti-aliasing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import pose_looking_at
from common.scene import Material, Scene
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.shadows import PLAIN, point, yard

Float64 = NDArray[np.float64]

SIZE = (40, 30)
PERIOD = 4
VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
STEP = View(pose_looking_at((3.05, 2.5, 3.95), (0.02, 0.4, 0.0)), Perspective(0.9, 0.05))
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)

FULL: dict[str, Any] = {**PLAIN, "shadows": "off", "taa": "full", "jitter_period": PERIOD}
"""Settings with a history in 32 bits, light of lamps alone, and a short period."""

EVEN: dict[str, Any] = {
    **FULL,
    "taa_average": False,
    "taa_constraint": "none",
    "taa_weight": "fixed",
    "taa_ycocg": False,
    "taa_velocity": "own",
    "taa_tolerance": 0.0,
}
"""The same with a fixed share, and nothing that depends on what the pixels around show."""


def court(material: Material | None = None) -> Scene:
    """Return a ground and a floating cube before a dark background, with one lamp."""
    return yard(LAMP, material=material)


def opened(
    chapter: Any, settings: Any, scene: Scene, *outputs: str, size: tuple[int, int] = SIZE, **turned: Any
) -> Any:
    """Return a renderer with the outputs "color_linear" and `outputs`."""
    return chapter.open(scene, size, replaced(settings, **turned), outputs={"color_linear", *outputs})


def light(frame: Any) -> Float64:
    """Return (H, W, 3) the light of a frame."""
    pixels: Float64 = frame.image("color_linear").astype(np.float64)
    return pixels


def frames_of(renderer: Any, count: int, view: View = VIEW) -> list[Float64]:
    """Return the light of so many frames of a view."""
    return [light(renderer.render(view)) for _ in range(count)]


def brighter(view: View, stops: float) -> View:
    """Return the view with an exposure that is longer by `stops`."""
    return replace(view, ev100=view.ev100 - stops)


def steady_state(samples: list[Float64], share: float) -> list[Float64]:
    """Return the pictures between which an exponential average alternates, if the samples come again and again.

    h_n = q h_{n-1} + share s_n with q = 1 - share over a period of P is h_P = q^P h_0 + share sum q^(P-n) s_n,
    so the state that repeats is h_0 = share sum q^(P-n) s_n / (1 - q^P).
    """
    kept, period = 1.0 - share, len(samples)
    sums = sum(share * kept ** (period - 1 - n) * sample for n, sample in enumerate(samples))
    state = sums / (1.0 - kept**period)
    states = []
    for sample in samples:
        state = kept * state + share * sample
        states.append(state)
    return states
