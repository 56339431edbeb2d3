"""Valid histories of a frame: those that the previous frame wrote in the same format and size, without a cut.

Each history has a bit in the frame's constants. A shader *selects* by this bit, as in `valid ? mix(now, before, weight)
: now`. It must not multiply by it: memory that was never written may hold NaN, and 0 times NaN is NaN.
"""

from __future__ import annotations

from typing import Any

from common import layouts

from .types import Graph

BITS = {name.lower(): bit for name, bit in layouts.CONSTANTS.items() if name.startswith("HISTORY_")}
"""The bit of each history in `FrameConstants.valid_histories`, by the name of its resource: "history_color"."""


class Histories:
    """The last frame that wrote each history, with its format and size."""

    def __init__(self) -> None:
        self._written: dict[str, tuple[int, Any]] = {}
        self._cached: tuple[Graph | None, dict[str, Any]] = (None, {})

    def valid(self, graph: Graph, number: int, reset: str) -> frozenset[str]:
        """Return the valid histories of frame `number`, counted since the renderer was opened; none after a reset."""
        if reset:
            return frozenset()
        return frozenset(
            name
            for name, shape in self._shapes(graph).items()
            if self._written.get(name) == (number - 1, shape)
        )

    def mask(self, graph: Graph, number: int, reset: str) -> int:
        """Return the same as bits; the lowest bit is set if there was a previous frame."""
        bits = sum(BITS.get(name, 0) for name in self.valid(graph, number, reset))
        return bits + (0 if reset else BITS["history_frame"])

    def rendered(self, graph: Graph, number: int) -> None:
        """Note that frame `number` was drawn with `graph` and wrote its histories."""
        self._written = {name: (number, shape) for name, shape in self._shapes(graph).items()}

    def forget(self) -> None:
        """Note that the images were created again."""
        self._written.clear()

    def _shapes(self, graph: Graph) -> dict[str, Any]:
        """Return format and size of each history of a graph, cached for the last graph."""
        if self._cached[0] is not graph:
            written = {name for step in graph.steps for name in step.writes}
            shapes = {
                name: (resource.format, resource.size, resource.slices, resource.bytes)
                for name, resource in graph.resources.items()
                if resource.life == "history" and name in written
            }
            self._cached = graph, shapes
        return self._cached[1]
