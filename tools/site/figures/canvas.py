"""A drawing in SVG whose colours follow the reader's scheme: boxes, arrows and words.

A figure stands alone as a file, where `prefers-color-scheme` chooses its colours. In a page that has a switch of its
own, the page sets the same variables (`--f-paper` ...) and the figure follows the switch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

LIGHT = {
    "paper": "#ffffff",
    "ink": "#18181b",
    "soft": "#52525b",
    "line": "#71717a",
    "card": "#f1f1f3",
    "mark": "#b91c1c",
    "a": "#bfdbfe",
    "b": "#fde68a",
    "c": "#bbf7d0",
    "d": "#fbcfe8",
    "e": "#ddd6fe",
    "f": "#fed7aa",
    "s1": "#1d4ed8",
    "s2": "#b45309",
    "s3": "#047857",
    "s4": "#a21caf",
}
"""Colours by what they are for: paper, words, lines, boxes, what is pointed out, six kinds of things, four curves."""

DARK = {
    "paper": "#16181d",
    "ink": "#f4f4f5",
    "soft": "#b4b4bd",
    "line": "#8b8b96",
    "card": "#2a2d34",
    "mark": "#fca5a5",
    "a": "#1e3a8a",
    "b": "#6b4a06",
    "c": "#14532d",
    "d": "#701a46",
    "e": "#4c1d95",
    "f": "#7c2d12",
    "s1": "#93c5fd",
    "s2": "#fbbf24",
    "s3": "#6ee7b7",
    "s4": "#f0abfc",
}

KINDS = ("a", "b", "c", "d", "e", "f")
CHARACTER = 0.56
"""Width of a character over the size of the font, on average of a sans-serif font."""

Point = tuple[float, float]


def variables(colors: Mapping[str, str]) -> str:
    """Return the colours as CSS variables."""
    return "".join(f"--f-{name}:{value};" for name, value in colors.items())


STYLE = (
    f".strata-figure{{{variables(LIGHT)}font-family:system-ui,sans-serif}}"
    f"@media (prefers-color-scheme:dark){{.strata-figure{{{variables(DARK)}}}}}"
)

SCHEMES = (
    f"\n[data-md-color-scheme=default] .strata-figure{{{variables(LIGHT)}}}\n"
    f"[data-md-color-scheme=slate] .strata-figure{{{variables(DARK)}}}\n"
)
"""Rules for a page with a switch of mkdocs-material: they win over those of a figure by itself."""


def width_of(text: str, size: float) -> float:
    """Return the width of a text in pixels, estimated."""
    return len(text) * size * CHARACTER


class Canvas:
    """Collects shapes; `svg` returns the file. Lengths are pixels, y counts downwards.

    `texts` has each text with its box (left, top, right, bottom), for tests.
    """

    def __init__(self, width: float, height: float, title: str) -> None:
        self.width, self.height, self.title = width, height, title
        self._shapes: list[str] = []
        self.texts: list[tuple[str, tuple[float, float, float, float]]] = []

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: float = 13,
        anchor: str = "start",
        role: str = "ink",
        bold: bool = False,
    ) -> None:
        """Write one line; (x, y) is on its base line, at the start, "middle" or "end"."""
        wide = width_of(text, size)
        left = x - {"start": 0.0, "middle": wide / 2, "end": wide}[anchor]
        self.texts.append((text, (left, y - 0.8 * size, left + wide, y + 0.2 * size)))
        weight = ' font-weight="600"' if bold else ""
        self._shapes.append(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}"{weight} '
            f'fill="var(--f-{role})">{escape(text)}</text>'
        )

    def note(self, x: float, y: float, text: str, role: str = "soft") -> None:
        """Write a line that explains the drawing."""
        self.text(x, y, text, 12, role=role)

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        label: str = "",
        fill: str = "card",
        size: float = 13,
        dashed: bool = False,
        round: float = 4,
        stroke: str = "line",
    ) -> None:
        """Draw a box with lines of text in its middle."""
        self.rectangle((x, y, width, height), fill, stroke, dashed, round)
        lines = label.split("\n") if label else []
        first = y + height / 2 + 0.35 * size - (len(lines) - 1) * 0.6 * size
        for number, line in enumerate(lines):
            self.text(x + width / 2, first + 1.2 * size * number, line, size, "middle")

    def rectangle(
        self, place: tuple[float, float, float, float], fill: str, stroke: str, dashed: bool, round: float
    ) -> None:
        """Draw a rectangle: x, y, width and height."""
        x, y, width, height = place
        dash = ' stroke-dasharray="4 3"' if dashed else ""
        self._shapes.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{round:g}" '
            f'fill="var(--f-{fill})" stroke="var(--f-{stroke})"{dash}/>'
        )

    def circle(self, x: float, y: float, radius: float, fill: str = "card", stroke: str = "line") -> None:
        """Draw a disc."""
        self._shapes.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="var(--f-{fill})" stroke="var(--f-{stroke})"/>'
        )

    def line(
        self,
        points: Sequence[Point],
        role: str = "line",
        width: float = 1.5,
        dashed: bool = False,
        arrow: bool = False,
    ) -> None:
        """Draw a line through points, with a head at its end if it is an arrow."""
        dash = ' stroke-dasharray="4 3"' if dashed else ""
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        self._shapes.append(
            f'<path d="{path}" fill="none" stroke="var(--f-{role})" stroke-width="{width:g}"{dash}/>'
        )
        if arrow:
            (x0, y0), (x, y) = points[-2], points[-1]
            self._head(x, y, math.atan2(y - y0, x - x0), role)

    def arrow(
        self, x0: float, y0: float, x: float, y: float, role: str = "line", dashed: bool = False
    ) -> None:
        """Draw a straight arrow."""
        self.line([(x0, y0), (x, y)], role, dashed=dashed, arrow=True)

    def curve(self, start: Point, bend: Point, end: Point, role: str = "line") -> None:
        """Draw an arrow that bends towards a point."""
        self._shapes.append(
            f'<path d="M{start[0]:.1f} {start[1]:.1f}Q{bend[0]:.1f} {bend[1]:.1f} {end[0]:.1f} {end[1]:.1f}" '
            f'fill="none" stroke="var(--f-{role})" stroke-width="1.5"/>'
        )
        self._head(*end, math.atan2(end[1] - bend[1], end[0] - bend[0]), role)

    def polygon(self, points: Sequence[Point], fill: str = "card", stroke: str = "line") -> None:
        """Draw a closed shape."""
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z"
        self._shapes.append(f'<path d="{path}" fill="var(--f-{fill})" stroke="var(--f-{stroke})"/>')

    def raw(self, shape: str) -> None:
        """Add an element as it is."""
        self._shapes.append(shape)

    def _head(self, x: float, y: float, angle: float, role: str) -> None:
        corners = [(x, y)]
        corners += [(x - 8 * math.cos(angle + s), y - 8 * math.sin(angle + s)) for s in (-0.4, 0.4)]
        self.polygon(corners, role, role)

    def svg(self) -> str:
        """Return the text of the file."""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="strata-figure" viewBox="0 0 {self.width:g} '
            f'{self.height:g}" width="{self.width:g}" height="{self.height:g}" role="img" '
            f'aria-label="{escape(self.title)}"><style>{STYLE}</style>'
            f'<rect width="{self.width:g}" height="{self.height:g}" rx="6" fill="var(--f-paper)"/>'
            f"{''.join(self._shapes)}</svg>\n"
        )
