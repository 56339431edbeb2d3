"""Which histories mean something in a frame: those that the very frame before wrote, as they are now, without a cut.

A shader is told by a bit of the frame's constants and *selects* by it: `valid ? mix(now, before, weight) : now`. It
must not multiply by it, since what is in memory that was never written may be NaN, and 0 times NaN is NaN.
"""

from __future__ import annotations

from typing import Any

from common import layouts

from .types import Graph

BITS = {name.lower(): bit for name, bit in layouts.CONSTANTS.items() if name.startswith("HISTORY_")}
"""The bit of each history in `FrameConstants.valid_histories`, by the name of its resource: "history_color"."""


class Histories:
    """Remembers which frame wrote each history last, and how it looked then."""

    def __init__(self) -> None:
        self._written: dict[str, tuple[int, Any]] = {}
        self._of: tuple[Graph | None, dict[str, Any]] = (None, {})

    def valid(self, graph: Graph, number: int, reset: str) -> frozenset[str]:
        """Return the histories that frame `number` of a renderer's life may use; none where it was `reset`."""
        if reset:
            return frozenset()
        return frozenset(
            name
            for name, shape in self._shapes(graph).items()
            if self._written.get(name) == (number - 1, shape)
        )

    def mask(self, graph: Graph, number: int, reset: str) -> int:
        """Return the same as bits; the lowest says that there was a frame before at all."""
        found = sum(BITS.get(name, 0) for name in self.valid(graph, number, reset))
        return found + (0 if reset else BITS["history_frame"])

    def rendered(self, graph: Graph, number: int) -> None:
        """Note that frame `number` was drawn by `graph`: it wrote the histories that are in it."""
        self._written = {name: (number, shape) for name, shape in self._shapes(graph).items()}

    def forget(self) -> None:
        """Note that the images are other ones."""
        self._written.clear()

    def _shapes(self, graph: Graph) -> dict[str, Any]:
        """Return how each history looks that a graph writes; it is the same graph for many frames."""
        if self._of[0] is not graph:
            written = {name for step in graph.steps for name in step.writes}
            shapes = {
                name: (one.format, one.size, one.bytes)
                for name, one in graph.resources.items()
                if one.life == "history" and name in written
            }
            self._of = graph, shapes
        return self._of[1]
