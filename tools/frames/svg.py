"""A compiled graph as a drawing: a column for each pass, in the order of the frame, and everything along it.

    names of the passes, numbered; below them an arc for every edge, from the pass that comes first
    a lane for each queue, where there are several: its batches, and a line from each to those that wait for it
    a row for each resource: when it is alive, and who reads and writes it
    a box for each heap: which bytes (down) are whose, and when (across); what stands side by side shares memory

The drawing is SVG made of text. Its attributes have the colours of a light page, which every program shows; a browser
follows the reader's scheme, and the switch of a page that has one. Where the package graphviz and its program `dot` are
installed, the passes are drawn once more above it, as a net with the names of what goes from one to the other.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from html import escape
from importlib import import_module
from typing import Any

from common.names import stable_hash
from tools.frames.overlap import Graph
from tools.frames.report import Row, described, rows, shown_bytes
from tools.frames.svg_lanes import lanes

LONGEST = 40
"""Characters of a name that are shown; all of it appears under the pointer."""

_CHARACTER = 7.3
"""Pixels of a character: monospaced, 12 pixels high."""

_COLUMN, _ROW, _MARGIN = 34, 20, 16
_KINDS = {"graphics": "#e4e4e7", "compute": "#fde68a", "copy": "#bae6fd"}
_INK, _PALE, _LINE, _CARD, _PAPER = "#18181b", "#71717a", "#d4d4d8", "#f4f4f5", "white"
DARK = {
    _PAPER: "#16181d",
    _INK: "#f4f4f5",
    "black": "#f4f4f5",
    _PALE: "#b4b4bd",
    _LINE: "#52525b",
    _CARD: "#27272a",
    "#52525b": "#a1a1aa",
    _KINDS["graphics"]: "#3f3f46",
    _KINDS["compute"]: "#6b4a06",
    _KINDS["copy"]: "#0c4a6e",
}
"""The colour of a dark page for each colour of a light one."""


def svg(graph: Graph, title: str = "") -> str:
    """Return the drawing as the text of an SVG file."""
    return _Drawing(graph, title).whole()


def _tag(name: str, content: str = "", **attributes: Any) -> str:
    """Return an element; `content` is markup, values of attributes are text."""
    said = "".join(f' {key.replace("_", "-")}="{_text(value)}"' for key, value in attributes.items())
    return f"<{name}{said}>{content}</{name}>" if content else f"<{name}{said}/>"


def _text(value: object) -> str:
    """Return a value as markup takes it: escaped, numbers short, without characters that XML does not have."""
    if isinstance(value, float):
        value = f"{value:.1f}".removesuffix(".0")
    return escape(re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", str(value)))


def _short(name: str, longest: int = LONGEST) -> str:
    return name if len(name) <= longest else f"{name[: max(longest - 1, 0)]}…"


def color(name: str) -> str:
    """Return the colour of a resource: its own, and the same in every drawing."""
    return f"hsl({stable_hash(name) % 360} 65% 78%)"


def schemes(used: Iterable[str]) -> str:
    """Return the rules of style by which a drawing that uses these colours of resources follows a scheme."""
    dark = DARK | {light: light.replace("65% 78%", "45% 28%") for light in sorted({*used})}
    both = list(dark.items())
    values = {
        scheme: "".join(f"--g{number}:{pair[dark_one]};" for number, pair in enumerate(both))
        for scheme, dark_one in (("default", 0), ("slate", 1))
    }
    rules = [
        f'.strata-graph [{part}="{light}"]{{{part}:var(--g{number})}}'
        for number, (light, _) in enumerate(both)
        for part in ("fill", "stroke")
    ]
    ink = [*dark].index(_INK)
    return "\n".join(
        [
            f".strata-graph{{{values['default']}}}",
            f"@media (prefers-color-scheme:dark){{.strata-graph{{{values['slate']}}}}}",
            *(
                f"[data-md-color-scheme={scheme}] .strata-graph{{{value}}}"
                for scheme, value in values.items()
            ),
            f".strata-graph text:not([fill]){{fill:var(--g{ink})}}",
            *rules,
        ]
    )


class _Drawing:
    """Puts one part below the other; `y` is where the next begins."""

    def __init__(self, graph: Graph, title: str) -> None:
        self.graph, self.title = graph, title
        self.rows = rows(graph)
        longest = max((len(row.name) for row in self.rows), default=8)
        self.left = _MARGIN + max(min(longest, LONGEST), 8) * _CHARACTER + 10
        self.right = self.left + len(graph.steps) * _COLUMN
        self.width = self.right
        self.y = float(_MARGIN)
        self.parts: list[str] = []

    def whole(self) -> str:
        graph = self.graph
        memory = graph.memory
        self.line(self.title or "A frame", size=15, weight="bold")
        self.line(
            f"{graph.size[0]}x{graph.size[1]} pixels; transients take {shown_bytes(memory.size)}, each on its own "
            f"{shown_bytes(memory.alone)}",
            fill=_PALE,
        )
        self.line("grey draws, yellow computes, blue copies; W writes, R reads, X goes on", fill=_PALE)
        self.net()
        self.heads()
        self.arcs()
        self.lanes()
        self.grid_from = self.y
        for row in self.rows:
            self.row(row)
        self.y += 10
        for number in range(len(memory.heaps)):
            self.heap(number)
        for name, why in graph.left_out.items():
            self.line(f"left out: {_short(name)}: {why}", fill=_PALE)
        style = ".strata-graph text{font-family:ui-monospace,Menlo,Consolas,'DejaVu Sans Mono',monospace}"
        used = {color(name) for name in (*(row.name for row in self.rows), *memory.places)}
        width, height = round(self.width + _MARGIN), round(self.y + _MARGIN)
        return _tag(
            "svg",
            "\n".join(
                [
                    _tag("style", f"{style}\n{schemes(used)}"),
                    _tag("rect", width=width, height=height, fill=_PAPER),
                    *self.grid(),
                    *self.parts,
                    "",
                ]
            ),
            xmlns="http://www.w3.org/2000/svg",
            role="img",
            aria_label=self.title or "A frame",
            width=width,
            height=height,
            viewBox=f"0 0 {width} {height}",
            **{"class": "strata-graph"},
        )

    # --- pieces ---

    def middle(self, step: int) -> float:
        """Return the x of a step's column."""
        return self.left + (step + 0.5) * _COLUMN

    def write(self, x: float, y: float, text: str, size: int = 12, fill: str = _INK, **more: Any) -> None:
        """Put a text at a place, and make the drawing wide enough for it unless it is centred or turned."""
        self.parts.append(_tag("text", _text(text), x=x, y=y, font_size=size, fill=fill, **more))
        if not {"text_anchor", "transform"} & more.keys():
            self.width = max(self.width, x + len(text) * _CHARACTER * size / 12)

    def line(self, text: str, size: int = 12, fill: str = _INK, weight: str = "normal") -> None:
        """Write a line of its own."""
        self.y += size + 2
        self.write(_MARGIN, self.y, text, size, fill, font_weight=weight)
        self.y += 6

    def grid(self) -> list[str]:
        """Return the lines between the columns, which lie under everything else."""
        xs = [self.left + step * _COLUMN for step in range(len(self.graph.steps) + 1)]
        return [_tag("line", x1=x, y1=self.grid_from, x2=x, y2=self.grid_to, stroke=_CARD) for x in xs]

    @property
    def grid_to(self) -> float:
        return self.grid_from + _ROW * len(self.rows)

    # --- passes ---

    def net(self) -> None:
        """Draw the passes as Graphviz places them, where it is there."""
        drawn = net(self.graph)
        if drawn:
            self.y += 10
            self.parts.append(_tag("g", drawn[0], transform=f"translate({_MARGIN} {self.y:.0f})"))
            self.width = max(self.width, _MARGIN + drawn[1])
            self.y += drawn[2] + 10

    def heads(self) -> None:
        """Write the names of the passes over their columns, and their numbers."""
        longest = max((len(_short(step.name)) for step in self.graph.steps), default=0)
        turned = longest * _CHARACTER * 0.71  # the sine of 45 degrees
        self.y += turned + 20
        for number, step in enumerate(self.graph.steps):
            x, y = self.middle(number), self.y
            place = f"rotate(-45 {x:.1f} {y:.1f})"
            self.write(x, y, _short(step.name), transform=place)
            self.width = max(self.width, x + len(_short(step.name)) * _CHARACTER * 0.71 + 10)
        self.y += 16
        for number, step in enumerate(self.graph.steps):
            x = self.middle(number)
            about = f"{step.name} ({step.kind}), {len(step.barriers)} barriers"
            circle = _tag("circle", cx=x, cy=self.y, r=11, fill=_KINDS[step.kind])
            number_ = _tag(
                "text", str(number + 1), x=x, y=self.y + 4, font_size=11, fill=_INK, text_anchor="middle"
            )
            self.parts.append(_tag("g", _tag("title", _text(about)) + circle + number_))
        self.y += 11

    def arcs(self) -> None:
        """Draw the edges below the passes, each pair of passes once."""
        place = {step.name: number for number, step in enumerate(self.graph.steps)}
        pairs: dict[tuple[int, int], list[str]] = defaultdict(list)
        solid: set[tuple[int, int]] = set()
        for edge in self.graph.edges:
            pair = place[edge.before], place[edge.after]
            pairs[pair].append(f"{edge.after} {edge.why} {edge.name} of {edge.before}")
            if edge.why == "reads":
                solid.add(pair)
        deepest = max((after - before for before, after in pairs), default=0)
        height = min(24.0 + 9 * deepest, 150.0)
        for (before, after), names in sorted(pairs.items()):
            a, b = self.middle(before) + 3, self.middle(after) - 3
            depth = self.y + height * (after - before) / deepest * 1.25
            self.parts.append(
                _tag(
                    "path",
                    _tag("title", _text("\n".join(names))),
                    d=f"M{a:.1f} {self.y:.1f}C{a:.1f} {depth:.1f} {b:.1f} {depth:.1f} {b:.1f} {self.y:.1f}",
                    fill="none",
                    stroke="#52525b",
                    stroke_dasharray="none" if (before, after) in solid else "4 3",
                )
            )
        self.y += height + 8

    def lanes(self) -> None:
        """Draw the batches of several queues, each in its lane."""
        for name, says, at in lanes(self.graph, self.left, self.y, _COLUMN, _ROW):
            if name == "text":
                self.write(at.pop("x"), at.pop("y"), says, **at)
            else:
                self.parts.append(_tag(name, _tag("title", _text(says)), **at))
                self.y = max(self.y, at.get("y", 0.0) + 2 * _ROW)

    # --- resources ---

    def row(self, row: Row) -> None:
        """Draw when a resource is alive."""
        y = self.y + _ROW / 2
        x, end = self.left + row.first * _COLUMN, self.left + (row.last + 1) * _COLUMN
        box = _tag(
            "rect",
            _tag("title", _text(f"{row.name}: {described(row.resource)}")),
            x=x + 2,
            y=self.y + 2,
            width=end - x - 4,
            height=_ROW - 4,
            rx=3,
            fill=color(row.name) if row.resource.life == "transient" else _CARD,
            stroke=_LINE if row.resource.life in ("transient", "kept") else _PALE,
            stroke_dasharray="none" if row.resource.life in ("transient", "kept") else "3 2",
        )
        self.parts.append(box)
        self.write(self.left - 8, y + 4, _short(row.name), text_anchor="end")
        for step, sign in row.signs.items():
            self.write(self.middle(step), y + 4, sign, text_anchor="middle")
        self.write(self.right + 8, y + 4, described(row.resource), 11, _PALE)
        self.y += _ROW

    def heap(self, number: int) -> None:
        """Draw the bytes of a heap over the steps."""
        memory = self.graph.memory
        size = memory.heaps[number].size
        height = max(24.0, 200 * size / max(heap.size for heap in memory.heaps))
        self.line(f"heap {number + 1}: {shown_bytes(size)}")
        top = self.y
        frame = _tag(
            "rect", x=self.left, y=top, width=self.right - self.left, height=height, fill="none", stroke=_LINE
        )
        self.parts.append(frame)
        for name, place in memory.places.items():
            if place.heap != number:
                continue
            first, last = memory.lives[name]
            x, y = self.left + first * _COLUMN, top + height * place.offset / size
            width, tall = (last - first + 1) * _COLUMN, height * place.size / size
            about = f"{name}: {shown_bytes(place.size)} at {place.offset:,}"
            box = _tag("rect", x=x, y=y, width=width, height=tall, fill=color(name), stroke=_PAPER)
            self.parts.append(_tag("g", _tag("title", _text(about)) + box))
            if tall >= 12:
                fits = int((width - 6) / (_CHARACTER * 10 / 12))
                self.write(x + width / 2, y + tall / 2 + 4, _short(name, fits), 10, text_anchor="middle")
        self.y += height + 8


def net(graph: Graph) -> tuple[str, float, float] | None:
    """Return the passes as Graphviz draws them, with width and height in pixels; None where it is not installed."""
    try:
        graphviz = import_module("graphviz")
    except ImportError:
        return None
    drawing = graphviz.Digraph(
        graph_attr={"rankdir": "LR"},
        node_attr={"shape": "box", "style": "rounded", "fontname": "monospace", "fontsize": "10"},
        edge_attr={"fontname": "monospace", "fontsize": "8", "color": _PALE},
    )
    for step in graph.steps:
        drawing.node(graphviz.escape(step.name), graphviz.escape(_short(step.name)))
    for edge in graph.edges:
        style = "solid" if edge.why == "reads" else "dashed"
        ends = graphviz.escape(edge.before), graphviz.escape(edge.after)
        drawing.edge(*ends, label=graphviz.escape(_short(edge.name)), style=style)
    try:
        drawn: str = drawing.pipe("svg", encoding="utf-8")
    except (graphviz.ExecutableNotFound, graphviz.CalledProcessError):  # the package is there, and no program
        return None
    size = re.search(r'<svg width="([\d.]+)pt" height="([\d.]+)pt"', drawn)
    if size is None:
        return None
    points = 4 / 3  # pixels
    return drawn[size.start() :], float(size[1]) * points, float(size[2]) * points
