"""The lanes of a drawing: for each queue its batches above the columns of their steps, and a line for every wait."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tools.frames.overlap import Graph, batches_of, queues

Shape = tuple[str, str, dict[str, Any]]
"""Kind of the element, what it says (the title of all but texts), and its attributes."""


def lanes(graph: Graph, left: float, top: float, column: float, row: float) -> Iterator[Shape]:
    """Yield the shapes of several batches, nothing for one; all numbers are in pixels.

    A batch without steps stands in front of all or behind them. A wait for the frame before comes in from the left.
    """
    if len(batches_of(graph)) < 2:
        return
    there = queues(graph)
    for number, queue in enumerate(there):
        yield "text", queue, {"x": left - 12, "y": top + row * (2 * number + 1.2), "text_anchor": "end"}
    ends: list[tuple[float, float, float]] = []  # (left, right, middle)
    for number, batch in enumerate(graph.batches):
        y = top + row * (2 * there.index(batch.queue) + 0.5)
        first = min(batch.steps, default=0 if number == 0 else len(graph.steps))
        x, end = left + column * first + 2, left + column * (max(batch.steps, default=first - 1) + 1) - 2
        end = max(end, x + 4)
        ends.append((x, end, y + row / 2))
        names = ", ".join(graph.steps[step].name for step in batch.steps)
        fill = "#e4e4e7" if batch.queue == "graphics" else "#fde68a"
        about = f"batch {number + 1} on {batch.queue}: {names or 'no steps'}"
        yield "rect", about, {"x": x, "y": y, "width": end - x, "height": row, "rx": 9, "fill": fill}
        for step in batch.steps:
            at = {"x": left + column * (step + 0.5), "y": y + row * 0.7, "size": 11, "text_anchor": "middle"}
            yield "text", str(step + 1), at
    for number, batch in enumerate(graph.batches):
        for wait in batch.waits:
            (to, _, y), (_, start, before) = ends[number], ends[wait.batch]
            about = (
                f"batch {number + 1} waits for batch {wait.batch + 1}" + " of the frame before" * wait.before
            )
            path = f"M{left - 8 if wait.before else start:.1f} {before:.1f}L{to:.1f} {y:.1f}"
            dashes = "4 3" if wait.before else "none"
            yield "path", about, {"d": path, "fill": "none", "stroke": "#52525b", "stroke_dasharray": dashes}
