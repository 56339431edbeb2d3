"""The loop of a ray that goes through a hierarchy: each node and leaf, and the stack beside it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from chapters.ch12.rays.bvh.build import Tree
from tools.site.figures.canvas import Point
from tools.site.figures.ch12.walk import (
    DIRECTION,
    ORIGIN,
    Box,
    Visit,
    Walk,
    hierarchy,
    interval,
    segments,
    walk,
)
from tools.site.figures.film import Loop, Picture

SIZE = (600, 392)
SIDE, LEFT, TOP = 352.0, 20.0, 20.0
RATE = 1.25
HELD = 4
"""Frames for which the end is shown."""


@cache
def _found() -> tuple[Tree, Walk]:
    tree = hierarchy()
    return tree, walk(tree)


def _at(x: float, y: float) -> Point:
    return LEFT + SIDE * x, TOP + SIDE * (1 - y)


def _outline(c: Picture, box: Box, role: str, width: float) -> None:
    tree, _ = _found()
    (x0, y0), (x1, y1) = tree.low[box][:2].tolist(), tree.high[box][:2].tolist()
    corners = [_at(*corner) for corner in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))]
    c.line(corners, role, width)


def visits(c: Picture, number: int) -> None:
    """The square: each node and each leaf has a frame in which it is looked at, and one for what was found there."""
    tree, found = _found()
    step, ends = number // 2, number >= 2 * len(found.visits)
    past = found.visits[: step + number % 2]
    visit = found.visits[min(step, len(found.visits) - 1)]
    waiting = () if ends else visit.waiting if number % 2 else visit.before
    c.rectangle((LEFT, TOP, SIDE, SIDE), "card", "line", False, 0)
    if visit.box is not None and not ends:
        (x0, y1), (x1, y0) = tree.low[visit.box][:2].tolist(), tree.high[visit.box][:2].tolist()
        (left, top), (right, bottom) = _at(x0, y0), _at(x1, y1)
        c.rectangle((left, top, right - left, bottom - top), "a", "s1", False, 0)
    for node in range(len(tree.children)):
        for side in (0, 1):
            _outline(c, (node, side), "line", 0.5)
    for box in waiting:
        _outline(c, box, "s2", 2)
    if visit.box is not None and not ends:
        _outline(c, visit.box, "s1", 2.5)
    tested = {one for before in past for one in before.tested}
    for index, pair in enumerate(segments()):
        now = index in visit.tested and not ends
        role = "mark" if now else "s4" if index in tested else "ink"
        c.line([_at(*pair[0]), _at(*pair[1])], role, 2.4 if now or index in tested else 1.4)
    _ray(c, min((before.t for before in past), default=np.inf))
    _words(c, number, waiting)


def _ray(c: Picture, t: float) -> None:
    """Draw the ray up to the nearest hit so far; without one, to the border of the square."""
    end = ORIGIN + min(t, float((1 - ORIGIN[0]) / DIRECTION[0])) * DIRECTION
    c.line([_at(*ORIGIN), _at(*end)], "s3", 2.2)
    if t < np.inf:
        c.circle(*_at(*end), 5, "paper", "mark")


def _words(c: Picture, number: int, waiting: Sequence[Box]) -> None:
    _, found = _found()
    count = len(found.visits)
    x = LEFT + SIDE + 24
    if number < 2 * count:
        c.text(x, 40, f"step {number // 2 + 1} of {count}", 14, bold=True)
        c.text(x, 64, _told(found.visits[number // 2], number % 2 == 1), 13, role="s1")
    else:
        c.text(x, 40, "the end", 14, bold=True)
        c.text(x, 64, f"{len(found.dropped)} boxes behind the hit", 13, role="s2")
        c.text(x, 84, "are dropped", 13, role="s2")
    c.text(x, 124, "put off", 13, bold=True, role="s2")
    for place, box in enumerate(waiting):
        y = 136.0 + 26 * place
        c.rectangle((x, y, 150, 22), "f", "s2", False, 0)
        c.text(x + 8, y + 16, f"a box, entered at {_enters(box):.2f}", 12)
    if len(waiting) > 1:
        c.note(x, 136 + 26 * len(waiting) + 16, "the last one comes first")


def _told(visit: Visit, after: bool) -> str:
    """Return what a node or a leaf is, or what was found there."""
    tested = len(visit.tested)
    if not after:
        return f"a leaf: {tested} segment{'s' * (tested > 1)}" if tested else "a node: two boxes"
    if tested:
        return f"a hit at {visit.t:.2f}" if visit.t < np.inf else "no hit"
    return ("no box is entered", "one box is entered", "both: the nearer comes first")[len(visit.sides)]


def _enters(box: Box) -> float:
    tree, _ = _found()
    return interval(tree.low[box], tree.high[box], np.inf)[0]


VISITS = {
    "ch12-visits-loop": Loop(
        "A ray through a hierarchy, step by step: the nearer box first, the other one put off, a hit, and the end",
        "ch12-walk.svg",
        SIZE,
        2 * len(_found()[1].visits) + HELD,
        visits,
        RATE,
    )
}
