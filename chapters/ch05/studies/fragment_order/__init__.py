"""Study: in which order does a GPU shade the pixels of one triangle? Each fragment draws a number and says who had it.

Nobody promises an order. GPUs cut the picture into tiles and let many cores take what comes next, so it is another one
on every device, and often in every frame. It can be seen all the same: fragments may write to buffers, and an *atomic*
addition returns what was there before, to nobody twice. With that number a fragment enters itself into a list; another
draw then goes through the list and makes a point of each entry, coloured by its number, black first and white last.

The number is compared with the room in the list *after* it was drawn. To look at the counter first and to add then is
two steps, and between them others add as well: some would pass though the list is full, and write behind its end.
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
    """What a frame did: how many `points` it drew of its list."""

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
    """Return the entries of a list as they were packed, (N, 2): x and y."""
    return np.stack([nodes & 0xFFFF, nodes >> 16], axis=-1)
