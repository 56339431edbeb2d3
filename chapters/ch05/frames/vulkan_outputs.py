"""The last step of a frame: what was asked for is copied to where the CPU can read it."""

from __future__ import annotations

from collections.abc import Mapping

from backends.vulkan.device import Device
from backends.vulkan.readback import Readback
from backends.vulkan.resources import Buffer, Image

from ..graph.memory.vulkan_images import GraphImages
from ..graph.plan import COPY, on_cpu
from ..graph.types import Graph
from .frame import SLOTS
from .vulkan_commands import Commands


class CopyOutputs:
    """Copies outputs, and leaves them as a window copies them; the graph brings them into that layout."""

    name = COPY
    reads = writes = ()

    def __init__(self, device: Device) -> None:
        self._device = device
        self.readbacks: list[dict[str, Readback]] = [{} for _ in range(SLOTS)]
        """By slot the copy of each output that there is."""

    def attach(self, graph: Graph, images: GraphImages) -> list[Mapping[str, Image | Buffer]]:
        """Make the buffers for a graph's outputs; return them by slot, as the graph calls them."""
        self.close()
        self.readbacks = [
            {
                output: Readback(self._device, images.image(slot, name), f"{output}, slot {slot}")
                for output, name in graph.outputs.items()
                if on_cpu(output) in graph.resources
            }
            for slot in range(SLOTS)
        ]
        return [{on_cpu(output): one.buffer for output, one in held.items()} for held in self.readbacks]

    def record(self, commands: Commands) -> None:
        """Record the copies."""
        for readback in self.readbacks[commands.slot.index].values():
            readback.record(commands.handle)

    def close(self) -> None:
        """Free the buffers; no frame is in flight."""
        for held in self.readbacks:
            for readback in held.values():
                readback.close()
            held.clear()
