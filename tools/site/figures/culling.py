"""Streets from above, the tests of a view, and the loops of chapter 6: a prefix sum, and the two phases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point
from tools.site.figures.film import Loop, Picture

Float64 = NDArray[np.float64]

# --- a street from above ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """A house or a thing on the ground plan: its lower left corner and its size."""

    x: float
    y: float
    wide: float
    deep: float

    @property
    def corners(self) -> Float64:
        """(4, 2), counterclockwise with y upwards."""
        x, y, w, d = self.x, self.y, self.wide, self.deep
        return np.array([(x, y), (x + w, y), (x + w, y + d), (x, y + d)])


@dataclass(frozen=True)
class Eye:
    """A camera on the ground plan: where it stands, its direction and half of its angle of view, in radians."""

    x: float
    y: float
    direction: float
    half: float


def seen_from(eye: Eye, blocks: Sequence[Block], rays: int = 721) -> tuple[set[int], set[int]]:
    """Return the blocks in the frustum, and those of them that a ray hits first."""
    angles = eye.direction + np.linspace(-eye.half, eye.half, rays)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    hits = np.stack([_distances(eye, directions, block) for block in blocks])
    inside = {number for number in range(len(blocks)) if np.isfinite(hits[number]).any()}
    first = hits.argmin(axis=0)[np.isfinite(hits.min(axis=0))]
    return inside, set(first.tolist())


def _distances(eye: Eye, directions: Float64, block: Block) -> Float64:
    """Return the distance at which each ray enters a block, infinity if it does not."""
    low = np.array([block.x - eye.x, block.y - eye.y])
    with np.errstate(divide="ignore"):
        near, far = low / directions, (low + np.array([block.wide, block.deep])) / directions
    enter, leave = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


STREET = (
    *(Block(2.0 + 3.2 * column, 4.2, 2.4, 2.0) for column in range(4)),
    *(Block(2.0 + 3.2 * column, 7.4, 2.4, 1.4) for column in range(4)),
    *(Block(x, 2.6, 0.5, 0.5) for x in (1.0, 5.6, 8.9, 12.6)),
    Block(0.0, 0.2, 2.0, 1.0),
    Block(13.0, 0.2, 2.0, 1.0),
)
LOOKS = Eye(7.5, 0.6, math.pi / 2, 0.62)


def tests() -> Canvas:
    """A street from above: what is outside, what is hidden, which sides face away."""
    c = Canvas(760, 330, "A street from above: objects outside, hidden and drawn, and sides that face away")
    inside, visible = seen_from(LOOKS, STREET)
    scale, left, bottom = 31.0, 16.0, 300.0

    def place(x: float, y: float) -> Point:
        return left + scale * x, bottom - scale * y

    reach = 9.2
    far = [place(LOOKS.x + reach * math.tan(a), LOOKS.y + reach) for a in (-LOOKS.half, LOOKS.half)]
    c.line([far[0], place(LOOKS.x, LOOKS.y), far[1]], "line", 1.5, dashed=True)
    for number, block in enumerate(STREET):
        x, y = place(block.x, block.y + block.deep)
        fill = "a" if number in visible else "b" if number in inside else "paper"
        c.box(x, y, scale * block.wide, scale * block.deep, "", fill, dashed=number not in inside, round=1)
        if number in visible:
            for start, end in _backs(block):
                c.line([place(*start), place(*end)], "mark", 3)
    c.circle(*place(LOOKS.x, LOOKS.y), 5, "f", "ink")
    c.text(place(LOOKS.x, 0)[0] + 12, place(0, LOOKS.y)[1] + 5, "eye", 12)
    for number, (fill, words) in enumerate(
        (
            ("paper", "outside: the frustum test"),
            ("", "facing away: the cone test"),
            ("b", "hidden: the occlusion test"),
            ("a", "drawn"),
        )
    ):
        y = 60 + 42 * number
        if fill:
            c.box(520, y, 26, 22, "", fill, dashed=fill == "paper", round=1)
        else:
            c.line([(520, y + 11), (546, y + 11)], "mark", 3)
        c.text(556, y + 16, words, 13)
    c.note(520, 250, f"{len(STREET) - len(inside)} outside, {len(inside - visible)} hidden,")
    c.note(520, 268, f"{len(visible)} of {len(STREET)} drawn")
    c.note(16, 322, "Each test removes its own kind. The tests are made in this order.")
    return c


def _backs(block: Block) -> list[tuple[Point, Point]]:
    """Return the sides of a block that face away from the eye."""
    found = []
    corners = block.corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        outward = np.array([end[1] - start[1], start[0] - end[0]])
        if outward @ (start - (LOOKS.x, LOOKS.y)) >= 0:
            found.append(((float(start[0]), float(start[1])), (float(end[0]), float(end[1]))))
    return found


# --- a prefix sum -----------------------------------------------------------------------------------------------------

FLAGS = (0, 1, 1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 0, 0, 1, 0)
COUNT = len(FLAGS)
STEPS = COUNT.bit_length() - 1
HOLD = 4
"""Frames that show a finished step; its bar grows meanwhile."""
PER_STEP = COUNT + HOLD
SUM_FRAMES = STEPS * PER_STEP + sum(FLAGS) + 6


@cache
def scan() -> tuple[tuple[int, ...], ...]:
    """Return the values before each step of the scan, and after the last."""
    values = [np.array(FLAGS)]
    for step in range(STEPS):
        before = values[-1]
        values.append(before + np.r_[np.zeros(2**step, before.dtype), before[: -(2**step)]])
    return tuple(tuple(row.tolist()) for row in values)


def prefix_sum(c: Picture, number: int) -> None:
    """Flags of units above, their sums below, and at the end the survivors at their places."""
    step, within = min(number // PER_STEP, STEPS), number - PER_STEP * min(number // PER_STEP, STEPS)
    placed = 0 if step < STEPS else min(within, sum(FLAGS))
    done = min(within, COUNT) if step < STEPS else COUNT
    before, after = scan()[step], scan()[min(step + 1, STEPS)]
    left, wide = 112.0, 32.0
    c.text(12, 40, "drawn?")
    c.text(12, 110, "sums")
    c.text(12, 194, "list")
    for place, flag in enumerate(FLAGS):
        x = left + wide * place
        c.box(x, 22, 28, 28, str(flag), "a" if flag else "paper", 12)
        new = place < done
        c.box(
            x, 92, 28, 28, str((after if new else before)[place]), "b" if new and step < STEPS else "card", 12
        )
        c.box(x, 176, 28, 28, "", "paper", dashed=True)
    if step < STEPS:
        distance = 2**step
        c.text(12, 148, f"step {step + 1}: add the value {distance} before", 12, role="mark")
        place = done - 1
        if place >= distance and within < COUNT:
            x = left + wide * place + 14
            c.line(
                [(x - wide * distance, 92), (x - wide * distance, 80), (x, 80), (x, 92)],
                "mark",
                2,
                arrow=True,
            )
        c.box(left, 158, wide * COUNT - 4, 4, "", "paper", round=1)
        c.box(left, 158, (wide * COUNT - 4) * (within + 1) / PER_STEP, 4, "", "b", round=1)
        return
    c.text(12, 148, "a survivor's place: the sum before its own", 12, role="mark")
    survivors = [place for place, flag in enumerate(FLAGS) if flag]
    for place in survivors[:placed]:
        to = scan()[STEPS][place] - 1
        c.box(left + wide * to, 176, 28, 28, str(place), "a", 12)
    if placed > 0 and within <= len(survivors):
        place = survivors[placed - 1]
        c.arrow(left + wide * place + 14, 120, left + wide * (scan()[STEPS][place] - 1) + 14, 176, "mark")
    c.box(left, 158, (wide * COUNT - 4) * (within + 1) / (SUM_FRAMES - STEPS * PER_STEP), 4, "", "a", round=1)


# --- a camera that turns ----------------------------------------------------------------------------------------------

TURNS = 72
"""Frames of the film, over a whole turn."""
CITY = tuple(
    Block(0.4 + 2.6 * column, 0.4 + 2.2 * row, 1.9, 1.4)
    for row in range(4)
    for column in range(5)
    if (row, column) not in ((1, 2), (2, 2))
)
STANDS = Eye(6.55, 4.45, 0.0, 0.55)


@cache
def turn() -> tuple[tuple[frozenset[int], frozenset[int]], ...]:
    """Return for each frame the blocks in the frustum, and the visible ones."""
    found = []
    for number in range(TURNS):
        eye = replace(STANDS, direction=2 * math.pi * number / TURNS)
        inside, visible = seen_from(eye, CITY)
        found.append((frozenset(inside), frozenset(visible)))
    return tuple(found)


def phases(number: int) -> tuple[frozenset[int], frozenset[int], frozenset[int]]:
    """Return the blocks that a frame draws early, draws late, and leaves out as hidden."""
    (inside, visible), (_, before) = turn()[number], turn()[number - 1]
    early = before & inside
    return early, visible - early, inside - visible - early


def two_phases(c: Picture, number: int) -> None:
    """A street from above: blocks that are drawn early and late, hidden ones, and those outside."""
    early, late, hidden = phases(number)
    scale, left, bottom = 27.0, 16.0, 248.0

    def place(x: float, y: float) -> tuple[float, float]:
        return left + scale * x, bottom - scale * y

    eye = replace(STANDS, direction=2 * math.pi * number / TURNS)
    edges = [eye.direction - eye.half, eye.direction + eye.half]
    for angle in edges:
        c.line([place(eye.x, eye.y), place(*_edge(eye, angle))], "line", 1.5)
    for index, block in enumerate(CITY):
        x, y = place(block.x, block.y + block.deep)
        kind = "a" if index in early else "f" if index in late else "card" if index in hidden else "paper"
        outside = kind == "paper"
        c.box(x, y, scale * block.wide, scale * block.deep, "", kind, dashed=outside, round=1)
    c.circle(*place(eye.x, eye.y), 5, "mark", "ink")
    for row, (fill, words, count) in enumerate(
        (
            ("a", "early: seen by the last frame", len(early)),
            ("f", "late: not seen before", len(late)),
            ("card", "hidden", len(hidden)),
            ("paper", "outside", len(CITY) - len(early) - len(late) - len(hidden)),
        )
    ):
        y = 44 + 44 * row
        c.box(384, y, 24, 22, str(count), fill, 12, dashed=fill == "paper", round=1)
        c.text(418, y + 16, words, 13)
    c.note(384, 236, "Each frame draws blue, then orange.")


def _edge(eye: Eye, angle: float) -> tuple[float, float]:
    """Return where a ray of the frustum leaves the ground plan."""
    dx, dy = math.cos(angle), math.sin(angle)
    ways = [((13.2 if dx > 0 else 0.0) - eye.x) / dx if abs(dx) > 1e-9 else math.inf]
    ways.append(((8.6 if dy > 0 else 0.0) - eye.y) / dy if abs(dy) > 1e-9 else math.inf)
    return eye.x + min(ways) * dx, eye.y + min(ways) * dy


CULLING = {
    "ch06-prefix-sum-loop": Loop(
        "A prefix sum in shared memory: in each step every value adds the one 1, 2, 4 or 8 places before it",
        "ch06-compaction.svg",
        (640, 216),
        SUM_FRAMES,
        prefix_sum,
        8.0,
    ),
    "ch06-two-phases-loop": Loop(
        "A camera turns in a street seen from above: blocks that are drawn early, drawn late, hidden, and outside",
        "ch06-two-phases.svg",
        (640, 264),
        TURNS,
        two_phases,
        5.0,
    ),
}
"""The loops by name; their stills are figures of the lesson."""
