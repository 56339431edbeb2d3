"""The last step of a frame: copies of the requested outputs to memory that the CPU can read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import Pass

from ...graph.plan import COPY, on_cpu
from ...graph.types import Graph
from ..frame import SLOTS


class OutputCopies(Pass):
    """The copies of a frame's outputs, by slot. A backend creates them and records them."""

    name = COPY

    def __init__(self) -> None:
        self.readbacks: list[dict[str, Any]] = [{} for _ in range(SLOTS)]
        """The copy of each output, by slot."""
        self.also: list[dict[str, Any]] = [{} for _ in range(SLOTS)]
        """Buffers of techniques that passes declare, by slot and name."""

    def attach(self, graph: Graph, images: Any) -> list[Mapping[str, Any]]:
        """Create the buffers for a graph's outputs; return them by slot, under their names in the graph."""
        self.close()
        self.readbacks = [
            {
                output: self._readback(images.image(slot, name), f"{output}, slot {slot}")
                for output, name in graph.outputs.items()
                if on_cpu(output) in graph.resources
            }
            for slot in range(SLOTS)
        ]
        return [
            {on_cpu(output): copy.buffer for output, copy in copies.items()} | self.also[slot]
            for slot, copies in enumerate(self.readbacks)
        ]

    def _readback(self, image: Any, name: str) -> Any:
        """Return the copy of an image, with a buffer of its own."""
        raise NotImplementedError

    def close(self) -> None:
        """Free the buffers; no frame is in flight."""
        for copies in self.readbacks:
            for readback in copies.values():
                readback.close()
            copies.clear()
