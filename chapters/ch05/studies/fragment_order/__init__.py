"""Study: in which order does a GPU shade the pixels of one triangle? Each fragment takes a number and lists its pixel.

No API promises an order. GPUs cut the picture into tiles that many cores take as they become free, so the order differs
between devices, and often between frames. Buffers can show it: fragments may write to them, and an *atomic* addition
returns the value before it, each value only once. With that number a fragment enters its pixel into a list. Another
draw then makes a point of each entry, coloured by its number, black first and white last.

A fragment compares its number with the room in the list *after* the addition. Reading the counter first and adding then
are two steps, and other fragments add between them. Some fragments would then pass though the list is full, and write
beyond its end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="fragment order",
    idea="An atomic addition gives each fragment a number of its own, and the numbers show in which order they came.",
    order=4,
    features=("compute/fragment-order-atomics",),
)

VERTICES = {"triangle": 3, "quad": 6}
"""Vertices of each shape."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    shape: str = knob("triangle", "what covers the picture", choices=tuple(VERTICES))
    percent: float = knob(
        100.0, "how many of the fragments are shown, the first ones", minimum=0.0, maximum=100.0
    )
    seconds: float = knob(2.0, "time in which they appear; 0: at once", minimum=0.0, maximum=60.0)


@dataclass
class OrderWork(Work):
    """What a frame did: the number of `points` that it drew of its list."""

    points: int = 0


COVER = ("studies/fragment_order/cover.vert", "studies/fragment_order/number.frag")
POINTS = ("studies/fragment_order/points.vert", "studies/fragment_order/points.frag")


def shown(settings: Settings, time: float, count: int) -> int:
    """Return how many of `count` fragments are shown at a time."""
    part = min(max(time / settings.seconds, 0.0), 1.0) if settings.seconds else 1.0
    return int(settings.percent / 100.0 * part * count)


def push(size: tuple[int, int], capacity: int) -> np.ndarray:
    """Return the push constants of both draws, (4,) uint32: the picture's size, and the room in the list."""
    return np.array([*size, capacity, 0], np.uint32)


def places(nodes: np.ndarray) -> np.ndarray:
    """Return the packed entries of a list as (N, 2): x and y."""
    return np.stack([nodes & 0xFFFF, nodes >> 16], axis=-1)
