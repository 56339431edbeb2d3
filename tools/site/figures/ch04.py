"""Figures of chapter 4: edges from names; barriers, lifetimes and memory of the frame with a lens; histories."""

from __future__ import annotations

from typing import Any

from chapters.ch04.graph.names import connect
from chapters.ch04.studies.glow import declared
from tools.frames.report import Row, rows, shown_bytes

from .canvas import KINDS, Canvas
from .graphs import lens_frame

LEFT, COLUMN, ROW = 170, 72, 26
"""Pixels of the names, of a step and of a resource."""


def names_and_edges() -> Canvas:
    """The passes of the study names: an edge from the writer of a name to each of its readers."""
    c = Canvas(760, 230, "Passes as boxes, and the names that they read and write as arrows")
    wiring = connect(declared(), {}, {})
    depth: dict[str, int] = {}
    for _ in wiring.nodes:
        for node in wiring.nodes:
            before = [depth.get(edge.before, 0) + 1 for edge in wiring.edges if edge.after == node.name]
            depth[node.name] = max(before, default=0)
    place = {name: (14 + 126 * level, 60.0) for name, level in depth.items()}
    for edge in wiring.edges:
        (x0, y0), (x1, y1) = place[edge.before], place[edge.after]
        if x1 - x0 > 130:
            c.curve((x0 + 48, y0), ((x0 + x1) / 2 + 48, y0 - 76), (x1 + 40, y1))
            c.text((x0 + x1) / 2 + 48, y0 - 44, edge.name, 12, "middle", "soft")
        else:
            c.arrow(x0 + 96, y0 + 20, x1, y1 + 20)
            c.text((x0 + 96 + x1) / 2, y0 + 56, edge.name, 12, "middle", "soft")
    for name, (x, y) in place.items():
        c.box(x, y, 96, 40, name, "a")
    c.box(140, 160, 96, 40, "outline", "card", dashed=True)
    c.line([(62, 100), (62, 180), (140, 180)], "line", dashed=True, arrow=True)
    c.note(248, 184, "left out: no pass reads what it writes")
    return c


def _rows(graph: Any) -> list[Row]:
    return [row for row in rows(graph) if row.resource.kind != "buffer"]


def _head(c: Canvas, graph: Any, top: float) -> None:
    """Write the names of the steps above their columns, on two lines."""
    for number, step in enumerate(graph.steps):
        words = step.name.replace("circle_of_confusion", "circle_of_ confusion").replace("_of_f", "_of_ f")
        for line, word in enumerate(words.split(" ")[:2]):
            c.text(LEFT + COLUMN * (number + 0.5), top + 14 * line, word, 11, "middle")


def barriers_of_a_frame() -> Canvas:
    """The frame with a lens: who reads and writes which image, and where a barrier stands."""
    graph = lens_frame()
    listed = _rows(graph)
    c = Canvas(
        LEFT + COLUMN * len(graph.steps) + 14,
        96 + ROW * len(listed),
        "Barriers between the passes of the frame with a lens",
    )
    _head(c, graph, 22)
    for number, row in enumerate(listed):
        y = 50 + ROW * number
        c.text(12, y + 16, row.name, 12)
        c.line([(LEFT, y + 22), (c.width - 14, y + 22)], "card", 1)
        for step, sign in row.signs.items():
            x = LEFT + COLUMN * step + 12
            c.box(x, y + 2, COLUMN - 18, 19, _does(sign), {"W": "f", "X": "d"}.get(sign, "a"), 11)
        for step, planned in enumerate(graph.steps):
            barriers = [one for one in planned.barriers if one.resource == row.name]
            if barriers:
                x = LEFT + COLUMN * step + 6
                c.line([(x, y), (x, y + 23)], "soft" if barriers[0].discard else "mark", 3)
    y = 50 + ROW * len(listed) + 18
    c.note(12, y, "red: a barrier that waits for a write of this frame, or changes a layout", "mark")
    c.text(
        12,
        y + 18,
        "grey: the first use; it waits for the last user of the memory, and loses the old contents",
        12,
        role="soft",
    )
    return c


def _does(sign: str) -> str:
    return {"W": "write", "R": "read", "X": "write on"}[sign]


def lives_and_heap() -> Canvas:
    """The heap of the frame with a lens: steps to the right, bytes downwards; each image is a box."""
    graph = lens_frame()
    memory = graph.memory
    (heap, *others) = memory.heaps
    assert not others, "the frame has one heap"
    high = 330
    c = Canvas(
        LEFT + COLUMN * len(graph.steps) + 14, high + 110, "The images of the frame with a lens in one heap"
    )
    _head(c, graph, 22)
    top, scale = 46, high / heap.size
    c.box(LEFT, top, COLUMN * len(graph.steps), high, "", "paper", round=0)
    c.text(LEFT - 10, top + 10, "0", 12, "end", "soft")
    c.text(LEFT - 10, top + high, shown_bytes(heap.size), 12, "end", "soft")
    c.text(LEFT - 10, top + high / 2, "bytes of the heap", 12, "end", "soft")
    for number, (name, place) in enumerate(sorted(memory.places.items(), key=lambda item: item[1].offset)):
        first, last = memory.lives[name]
        x, wide = LEFT + COLUMN * first + 1, COLUMN * (last - first + 1) - 2
        tall = place.size * scale
        c.box(
            x,
            top + place.offset * scale,
            wide,
            tall,
            name if tall > 11 else "",
            KINDS[number % 6],
            11,
            round=2,
        )
    c.text(
        12,
        high + 74,
        f"{shown_bytes(memory.size)} in the heap; {shown_bytes(memory.alone)} if each image had memory of its own.",
        13,
    )
    c.text(
        12,
        high + 94,
        "Boxes with a step in common lie at different bytes. Boxes at the same bytes have no step in common.",
        12,
        role="soft",
    )
    return c


def previous_frame() -> Canvas:
    """What a frame leaves to the next one: a history's two images change places, transients are only waited for."""
    c = Canvas(
        760, 300, "What the previous frame leaves: histories that swap, and transients that are waited for"
    )
    for number in range(3):
        x = 20 + 250 * number
        c.text(x, 28, f"frame {number}, slot {number % 2}", bold=True)
        c.box(x, 44, 210, 190, "", "card")
        now, before = ("history A", "history B")[:: 1 - 2 * (number % 2)]
        c.box(x + 14, 60, 84, 44, f"{now}\nwritten", "f" if now.endswith("A") else "b", 12)
        valid = number > 0
        c.box(
            x + 112,
            60,
            84,
            44,
            f"{before}\n{'read' if valid else 'not valid'}",
            "b" if now.endswith("A") else "f",
            12,
            dashed=not valid,
        )
        c.box(x + 14, 130, 182, 36, "transients", "a", 12)
        c.box(x + 14, 186, 182, 36, "output", "c", 12)
    for x, y in ((20, 113), (270, 121)):
        c.line([(x + 56, 104), (x + 56, y), (x + 404, y), (x + 404, 104)], "mark", arrow=True)
        c.arrow(x + 196, 148, x + 264, 148, dashed=True)
    c.note(20, 258, "red: what a frame wrote, the next one reads; the images change places", "mark")
    c.text(
        20,
        276,
        "dashed: the first use of a transient waits for the last use in the frame before; contents are lost",
        12,
        role="soft",
    )
    return c


FIGURES = {
    "ch04-names-and-edges": names_and_edges,
    "ch04-barriers-of-a-frame": barriers_of_a_frame,
    "ch04-lives-and-heap": lives_and_heap,
    "ch04-previous-frame": previous_frame,
}
