"""Charts on a canvas: curves over two axes, and bars. A chart shows one claim, and its curves are named beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tools.site.figures.canvas import Canvas, Point, width_of

COLORS = ("s1", "s2", "s3", "s4")
LEFT, TOP, RIGHT, BOTTOM = 62.0, 62.0, 190.0, 74.0
"""Room around the axes: for numbers, the title, the names of curves, and words below."""
LINE = 16.0
"""Distance of names that would lie over each other."""


@dataclass(frozen=True)
class Curve:
    """A named curve, with marks at its points; `words` are written beside single points."""

    name: str
    points: Sequence[Point]
    dashed: bool = False
    words: Sequence[str] = ()
    marks: bool = True


@dataclass(frozen=True)
class Axis:
    """An axis: what it measures with the unit, and whether it is logarithmic. A linear one begins at `begin`."""

    title: str
    log: bool = False
    begin: float = 0.0

    def ticks(self, values: Sequence[float]) -> list[float]:
        """Return numbers that enclose the values: powers of ten, or round numbers."""
        low, high = min(values), max(values)
        if self.log:
            first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
            return [10.0**power for power in range(first, max(last, first + 1) + 1)]
        step = 10.0 ** math.floor(math.log10((high - self.begin) / 2))
        step *= next(factor for factor in (1, 2, 5, 10) if (high - self.begin) / (step * factor) <= 5)
        count = math.ceil((high - self.begin) / step - 1e-9)
        return [self.begin + step * i for i in range(count + 1)]

    def place(self, value: float, ticks: Sequence[float]) -> float:
        """Return where a value is between the first tick, 0, and the last one, 1."""
        low, high = ticks[0], ticks[-1]
        if self.log:
            return math.log(value / low) / math.log(high / low)
        return (value - low) / (high - low)


def number(value: float) -> str:
    """Return a number as axes and bars have it: three digits, 10,000 with its comma, powers of ten below 0.001."""
    if value == 0:
        return "0"
    if abs(value) < 0.001:
        return f"{value:.0e}".replace("e-0", "e-")
    return f"{float(f'{value:.3g}'):,.10g}"


def curves(
    title: str, x: Axis, y: Axis, shown: Sequence[Curve], origin: str, size: tuple[float, float] = (720, 376)
) -> Canvas:
    """Return a chart of curves; `origin` says on what and how it was measured."""
    c = Canvas(*size, title)
    c.text(LEFT, 24, title, 14, bold=True)
    across = x.ticks([point[0] for one in shown for point in one.points])
    up = y.ticks([point[1] for one in shown for point in one.points])
    wide, tall = size[0] - LEFT - RIGHT, size[1] - TOP - BOTTOM

    def at(point: Point) -> Point:
        return LEFT + wide * x.place(point[0], across), TOP + tall * (1 - y.place(point[1], up))

    for value in up:
        height = at((across[0], value))[1]
        c.line([(LEFT, height), (LEFT + wide, height)], "card", 1)
        c.text(LEFT - 8, height + 4, number(value), 11, "end", "soft")
    for value in across:
        along = at((value, up[0]))[0]
        c.line([(along, TOP + tall), (along, TOP + tall + 5)], "line", 1)
        c.text(along, TOP + tall + 18, number(value), 11, "middle", "soft")
    c.line([(LEFT, TOP), (LEFT, TOP + tall), (LEFT + wide, TOP + tall)], "line", 1)
    c.text(LEFT + wide, TOP + tall + 36, x.title, 12, "end", "soft")
    c.text(LEFT, TOP - 14, y.title, 12, "start", "soft")
    c.note(LEFT, size[1] - 12, origin)
    _named(c, [(one.name, *at(max(one.points))) for one in shown], LEFT + wide + 12)
    for one, color in zip(shown, COLORS, strict=False):
        places = [at(point) for point in one.points]
        c.line(places, color, 2, one.dashed)
        for place in places if one.marks else ():
            c.circle(*place, 3.5, color, color)
        for place, word in zip(places, one.words, strict=False):
            if word:
                c.text(place[0] + 8, place[1] - 6, word, 11)
    return c


def _named(c: Canvas, ends: Sequence[tuple[str, float, float]], x: float) -> None:
    """Write the names of curves at the height of their ends, from the top down, each in its colour's company."""
    below = 0.0
    colors = {name: color for (name, _, _), color in zip(ends, COLORS, strict=False)}
    for name, end, height in sorted(ends, key=lambda one: one[2]):
        y = max(height + 4, below)
        below = y + LINE
        if end < x - 20 or abs(y - height - 4) > 1:
            c.line([(end + 5, height), (x - 3, y - 4)], "line", 0.5)
        c.line([(x, y - 4), (x + 14, y - 4)], colors[name], 3)
        c.text(x + 19, y, name, 12)


def bars(
    title: str,
    unit: str,
    groups: Sequence[tuple[str, Sequence[tuple[str, float, str]]]],
    origin: str,
    width: float = 720,
) -> Canvas:
    """Return a chart of bars in groups: of each its name, its length and a remark behind the number."""
    rows = sum(len(group) + bool(head) for head, group in groups)
    c = Canvas(width, 58 + 22 * rows + 10 * len(groups) + 22, title)
    c.text(16, 24, title, 14, bold=True)
    names = max(width_of(name, 12) for _, group in groups for name, _, _ in group)
    left = 30 + names
    longest = max(value for _, group in groups for _, value, _ in group)
    said = max(width_of(_said(value, unit, more), 12) for _, group in groups for _, value, more in group)
    room = width - left - said - 30
    y = 44.0
    for head, group in groups:
        if head:
            c.text(16, y + 14, head, 12, bold=True)
            y += 22
        for place, (name, value, more) in enumerate(group):
            c.text(left - 8, y + 14, name, 12, "end")
            length = max(room * value / longest, 1.5)
            color = COLORS[place % len(COLORS)]
            c.raw(
                f'<rect x="{left:.1f}" y="{y + 3:.1f}" width="{length:.1f}" height="15" fill="var(--f-{color})"/>'
            )
            c.text(left + length + 8, y + 14, _said(value, unit, more), 12)
            y += 22
        y += 10
    c.note(16, c.height - 12, origin)
    return c


def _said(value: float, unit: str, more: str) -> str:
    return f"{number(value)} {unit}{f', {more}' if more else ''}"
