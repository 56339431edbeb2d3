"""Samples of a column of froxels over frames: at a fixed depth, and turned by the golden ratio; a loop of means."""

from __future__ import annotations

import math
from functools import cache

from tools.site.figures.canvas import Canvas
from tools.site.figures.film import Loop, Picture

GOLDEN = (math.sqrt(5) - 1) / 2
FRAMES, SLICES = 8, 5
RANK = 0.30
"""The blue noise of the column in the figure."""

COLUMNS, SHOWN = 8, 32
"""Of the loop: froxels beside each other in one slice, and frames."""
RANKS = (0.12, 0.62, 0.31, 0.87, 0.44, 0.02, 0.75, 0.53)
"""Their blue noise: neighbours are far apart."""
EDGES = tuple(0.08 + 0.12 * column for column in range(COLUMNS))
"""The part of each froxel's slice that is lit: the edge of a shadow crosses the slice."""


def part(rank: float, frame: int, index: int) -> float:
    """Return where in its slice a froxel takes its sample, 0 to 1; fog/grid.glsl has the same sum."""
    return (rank + GOLDEN * (frame + index)) % 1.0


def samples_over_frames() -> Canvas:
    """Slices of a column upwards, frames across, without jitter and with it."""
    c = Canvas(
        760,
        330,
        "A column of froxels over eight frames: samples at the middle of each slice, and samples that the golden ratio "
        "moves",
    )
    wide, tall, top = 34.0, 44.0, 60.0
    for left, jitter, title in ((60.0, False, "fixed depth"), (430.0, True, "turned by the golden ratio")):
        c.text(left, 26, title, 13, bold=True)
        for index in range(SLICES):
            y = top + tall * (SLICES - 1 - index)
            c.rectangle((left, y, wide * FRAMES, tall), ("card", "paper")[index % 2], "line", False, 0)
            for frame in range(FRAMES):
                where = part(RANK, frame, index) if jitter else 0.5
                c.circle(left + wide * (frame + 0.5), y + tall * (1 - where), 4, "s1", "s1")
        for frame in range(FRAMES):
            c.text(left + wide * (frame + 0.5), top - 8, str(frame), 11, "middle", "soft")
    c.text(54, top - 8, "frame", 11, "end", "soft")
    for index in range(SLICES):
        y = top + tall * (SLICES - 1 - index) + tall / 2 + 4
        c.text(54, y, f"slice {index}" if not index else str(index), 11, "end", "soft")
    c.note(60, 304, "each frame has the same error")
    c.note(430, 304, "eight frames cover each slice evenly")
    return c


@cache
def means() -> list[list[float]]:
    """Return (frames, columns) the history of each froxel: the mean of samples that are lit, 1, or not, 0."""
    found, sums = [], [0] * COLUMNS
    for frame in range(SHOWN):
        for column in range(COLUMNS):
            sums[column] += part(RANKS[column], frame, 0) < EDGES[column]
        found.append([total / (frame + 1) for total in sums])
    return found


def history(c: Picture, number: int) -> None:
    """The samples of one frame, and the history after it."""
    wide, tall = 72.0, 150.0
    c.text(32, 26, f"frame {number}: samples in a slice, and the edge of a shadow", 13, bold=True)
    for column in range(COLUMNS):
        left = 32 + wide * column
        edge = EDGES[column]
        c.rectangle((left, 40, wide, tall * (1 - edge)), "card", "line", False, 0)
        c.rectangle((left, 40 + tall * (1 - edge), wide, tall * edge), "b", "line", False, 0)
        where = part(RANKS[column], number, 0)
        role = "s2" if where < edge else "ink"
        c.circle(left + wide / 2, 40 + tall * (1 - where), 5, role, role)
    c.text(32, 222, "history: the mean of all frames; the line is the lit part of the slice", 13, bold=True)
    for column in range(COLUMNS):
        left, mean = 32 + wide * column, means()[number][column]
        c.rectangle((left + 8, 376 - 136 * mean, wide - 16, 136 * mean + 0.5), "a", "line", False, 0)
        y = 376 - 136 * EDGES[column]
        c.line([(left + 4, y), (left + wide - 4, y)], "mark", 2.5)
    c.line([(32, 376), (32 + wide * COLUMNS, 376)], "line", 1)


JITTER = {
    "ch10-history-loop": Loop(
        "Samples move through a slice that the edge of a shadow crosses, and their mean approaches its lit part",
        "ch10-jitter.svg",
        (640, 392),
        SHOWN,
        history,
        4.0,
    )
}
