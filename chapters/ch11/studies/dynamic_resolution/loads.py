"""Loads for the controller without a clock: the time of a frame as a formula of its number and its scale.

    ms = target (FIXED + shading(n) s^2)

The fixed part is what does not depend on the number of pixels, such as culling and shadow maps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

FIXED = 0.1
"""Part of the target that a frame takes at any scale."""

LONG = 60
"""Frames between two steps, and half of the frames of a wave."""

LIGHT, HEAVY = 0.6, 1.6
"""Shading of the whole picture, in targets, when little and when much is seen."""


def _step(number: int) -> float:
    return HEAVY if number // LONG % 2 else LIGHT


def _wave(number: int) -> float:
    return (LIGHT + HEAVY) / 2 - (HEAVY - LIGHT) / 2 * math.cos(math.pi * number / LONG)


LOADS: Mapping[str, Callable[[int], float]] = {"step": _step, "wave": _wave}
"""Shading of the whole picture in targets, by the number of the frame."""


def frame_ms(load: str, number: int, scale: float, target_ms: float) -> float:
    """Return the time of frame `number` at a scale, in milliseconds."""
    return target_ms * (FIXED + LOADS[load](number) * scale * scale)
