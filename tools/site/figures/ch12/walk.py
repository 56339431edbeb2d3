"""A ray through a hierarchy over segments in a plane: which boxes it enters, what it puts off, and what it drops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chapters.ch12.rays.bvh.build import Tree, build
from tools.site.figures.canvas import Canvas

COUNT, LARGEST = 26, 2
ORIGIN, DIRECTION = np.array((0.02, 0.4)), np.array((1.0, -0.2))

Float64 = NDArray[np.float64]


def segments() -> Float64:
    """Return (COUNT, 2, 2) the ends of segments in a square of 1."""
    rng = np.random.default_rng(26)
    centres = rng.uniform(0.1, 0.9, (COUNT, 1, 2))
    return centres + rng.uniform(-0.07, 0.07, (COUNT, 2, 2))


def hierarchy() -> Tree:
    """Return the chapter's tree over the boxes of the segments."""
    ends = segments()
    flat = np.zeros((COUNT, 1))
    low, high = np.hstack([ends.min(axis=1), flat]), np.hstack([ends.max(axis=1), flat + 0.05])
    return build(low.astype(np.float32), high.astype(np.float32), largest=LARGEST)


def distance(ends: Float64) -> float:
    """Return t at which the ray crosses a segment, infinite if it does not."""
    a, along = ends[0], ends[1] - ends[0]
    across = DIRECTION[0] * along[1] - DIRECTION[1] * along[0]
    away = a - ORIGIN
    t = (away[0] * along[1] - away[1] * along[0]) / across
    s = (away[0] * DIRECTION[1] - away[1] * DIRECTION[0]) / across
    return float(t) if t > 0 and 0 <= s <= 1 else np.inf


def interval(low: NDArray[np.float32], high: NDArray[np.float32], far: float) -> tuple[float, float]:
    """Return where the ray enters and leaves a box of two axes."""
    one, other = (low[:2] - ORIGIN) / DIRECTION, (high[:2] - ORIGIN) / DIRECTION
    enter, leave = np.minimum(one, other).max(), np.maximum(one, other).min()
    return max(float(enter), 0.0), min(float(leave), far)


Box = tuple[int, int]
"""A node, and which of its two boxes."""


@dataclass(frozen=True)
class Visit:
    """A node or a leaf that was looked at. The root is in no box."""

    box: Box | None
    sides: tuple[int, ...]
    """The boxes of a node that the ray enters, the nearer one first."""
    tested: tuple[int, ...]
    """Segments, of a leaf."""
    t: float
    """The nearest hit after it."""
    before: tuple[Box, ...]
    waiting: tuple[Box, ...]
    """The stack before and after it."""


@dataclass
class Walk:
    """What happened to the boxes: entered, put off and dropped; segments that were tested; the hit."""

    entered: list[Box]
    dropped: list[Box]
    tested: list[int]
    t: float
    visits: list[Visit]

    @property
    def deepest(self) -> int:
        """The most that stood on the stack."""
        return max(len(visit.waiting) for visit in self.visits)


def walk(tree: Tree) -> Walk:
    """Go through the tree as the chapter's traversal does: the nearer child first, the other one on a stack."""
    walk = Walk([], [], [], np.inf, [])
    stack: list[tuple[float, int, Box]] = []
    code, box = 0, None
    while True:
        here, sides, tested, popped = box, [], [], True
        before = tuple(waiting for _, _, waiting in stack)
        if code >= 0:
            spans = [interval(tree.low[code, side], tree.high[code, side], walk.t) for side in (0, 1)]
            sides = [side for side in (0, 1) if spans[side][0] <= spans[side][1]]
            sides.sort(key=lambda side: spans[side][0])
            if len(sides) == 2:
                stack.append((spans[sides[1]][0], int(tree.children[code, sides[1]]), (code, sides[1])))
            if sides:
                box = code, sides[0]
                walk.entered.append(box)
                code, popped = int(tree.children[box]), False
        else:
            first, count = int(tree.first[~code]), int(tree.count[~code])
            tested = [int(number) for number in tree.order[first : first + count]]
            walk.tested += tested
            walk.t = min(walk.t, *(distance(segments()[number]) for number in tested))
        after = tuple(waiting for _, _, waiting in stack)
        walk.visits.append(Visit(here, tuple(sides), tuple(tested), walk.t, before, after))
        if popped:
            while stack:
                begins, code, box = stack.pop()
                if begins < walk.t:
                    walk.entered.append(box)
                    break
                walk.dropped.append(box)
            else:
                return walk


def walk_of_a_ray() -> Canvas:
    """The square with boxes and segments, and the counts."""
    tree, ends = hierarchy(), segments()
    found = walk(tree)
    c = Canvas(
        760, 400, "A ray through a hierarchy of boxes: those it enters, puts off and drops, and what it tests"
    )
    side, left, top = 360.0, 20.0, 20.0

    def at(x: float, y: float) -> tuple[float, float]:
        return left + side * x, top + side * (1 - y)

    c.rectangle((left, top, side, side), "card", "line", False, 0)
    kinds = {
        **dict.fromkeys(found.dropped, ("s2", 1.6, ' stroke-dasharray="4 3"')),
        **dict.fromkeys(found.entered, ("s1", 1.8, "")),
    }
    for node in range(len(tree.children)):
        for half in (0, 1):
            (x0, y1), (x1, y0) = tree.low[node, half, :2], tree.high[node, half, :2]
            role, width, dash = kinds.get((node, half), ("line", 0.6, ""))
            (px, py), (qx, qy) = at(float(x0), float(y0)), at(float(x1), float(y1))
            c.raw(
                f'<rect x="{px:.1f}" y="{py:.1f}" width="{qx - px:.1f}" height="{qy - py:.1f}" fill="none" '
                f'stroke="var(--f-{role})" stroke-width="{width}"{dash}/>'
            )
    for number, pair in enumerate(ends):
        tested = number in found.tested
        c.line([at(*pair[0]), at(*pair[1])], "mark" if tested else "ink", 2.4 if tested else 1.4)
    hit = ORIGIN + found.t * DIRECTION
    c.line([at(*ORIGIN), at(*hit)], "s3", 2.2, arrow=True)
    c.circle(*at(*hit), 5, "paper", "mark")
    lines = (
        (f"{COUNT} segments, {len(tree.children)} nodes of two boxes each", "ink"),
        (f"{len(found.visits)} steps: nodes and leaves that are looked at", "ink"),
        (f"{len(found.entered)} boxes are entered (blue)", "s1"),
        (f"{len(found.dropped)} were put off, and are behind the hit", "s2"),
        (f"{len(found.tested)} segments are tested (red)", "mark"),
        (f"{found.deepest} boxes at most lie on the stack", "ink"),
    )
    for number, (text, role) in enumerate(lines):
        c.text(400, 70 + 30 * number, text, 13, role=role)
    c.note(404, 280, "The nearer child comes first, so that a hit is")
    c.note(404, 298, "found early, and what lies behind it is dropped.")
    return c
