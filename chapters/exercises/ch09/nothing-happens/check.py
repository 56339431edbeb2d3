"""The rate of a fragment by the combiners of the pipeline, as the specification combines them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tools.exercises.checking import Given

Rate = tuple[int, int]

OPERATIONS: tuple[Callable[[Rate, Rate], Rate], ...] = (
    lambda a, b: a,
    lambda a, b: b,
    lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    lambda a, b: (a[0] * b[0], a[1] * b[1]),
)
"""VkFragmentShadingRateCombinerOpKHR 0 to 4: keep, replace, min, max, mul."""


def check(given: Given) -> None:
    """Primitives have 1x1 if no shader writes their rate."""
    state: Any = given.module("rates.vulkan").rates_of_attachment()
    draw = int(state.fragmentSize.width), int(state.fragmentSize.height)
    first, second = (OPERATIONS[int(number)] for number in state.combinerOps)
    for attachment in ((1, 1), (2, 2), (4, 4)):
        rate = second(first(draw, (1, 1)), attachment)
        given.need(
            rate == attachment,
            "Where the attachment has {}x{}, a fragment covers {}x{} pixels.".format(*attachment, *rate),
        )
