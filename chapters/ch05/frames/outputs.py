"""The last step of a frame: what was asked for is copied to where the CPU can read it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import Pass

from ..graph.plan import COPY, on_cpu
from ..graph.types import Graph
from .frame import SLOTS


class OutputCopies(Pass):
    """The copies of a frame's outputs, by slot. A backend makes a copy, and records it."""

    name = COPY

    def __init__(self) -> None:
        self.readbacks: list[dict[str, Any]] = [{} for _ in range(SLOTS)]
        """By slot the copy of each output that there is."""

    def attach(self, graph: Graph, images: Any) -> list[Mapping[str, Any]]:
        """Make the buffers for a graph's outputs; return them by slot, as the graph calls them."""
        self.close()
        self.readbacks = [
            {
                output: self._readback(images.image(slot, name), f"{output}, slot {slot}")
                for output, name in graph.outputs.items()
                if on_cpu(output) in graph.resources
            }
            for slot in range(SLOTS)
        ]
        return [{on_cpu(output): one.buffer for output, one in held.items()} for held in self.readbacks]

    def _readback(self, image: Any, name: str) -> Any:
        """Return what copies an image, with a buffer of its own."""
        raise NotImplementedError

    def close(self) -> None:
        """Free the buffers; no frame is in flight."""
        for held in self.readbacks:
            for readback in held.values():
                readback.close()
            held.clear()
