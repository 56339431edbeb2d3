"""The last step of a frame: what was asked for is copied to where the CPU can read it."""

from __future__ import annotations

from collections.abc import Mapping

from backends.gl.context import Context
from backends.gl.readback import Readback
from backends.gl.resources import Buffer, Image
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer

from ..graph.memory.gl_images import GraphImages
from ..graph.plan import COPY, on_cpu
from ..graph.types import Graph
from .frame import SLOTS
from .gl_commands import Commands


class CopyOutputs:
    """Copies outputs, and holds the framebuffer from which a window copies the picture."""

    name = COPY
    reads = writes = ()

    def __init__(self, context: Context) -> None:
        self._context = context
        self.readbacks: list[dict[str, Readback]] = [{} for _ in range(SLOTS)]
        """By slot the copy of each output that there is."""
        self.picture: Framebuffer | None = None
        """The picture, for a window."""

    def attach(self, graph: Graph, images: GraphImages) -> list[Mapping[str, Image | Buffer]]:
        """Make the buffers for a graph's outputs; return them by slot, as the graph calls them."""
        self.close()
        self.readbacks = [
            {
                output: Readback(self._context, images.image(slot, name), f"{output}, slot {slot}")
                for output, name in graph.outputs.items()
                if on_cpu(output) in graph.resources
            }
            for slot in range(SLOTS)
        ]
        if "color" in graph.names:
            color = images.image(0, graph.names["color"])
            self.picture = create_framebuffer(self._context, [color], None, "picture")
        return [{on_cpu(output): one.buffer for output, one in held.items()} for held in self.readbacks]

    def record(self, commands: Commands) -> None:
        """Make the copies; the graph has brought in front of them what they have to wait for."""
        for readback in self.readbacks[commands.slot.index].values():
            readback.copy()

    def close(self) -> None:
        """Free the buffers."""
        for held in self.readbacks:
            for readback in held.values():
                readback.close()
            held.clear()
        if self.picture is not None:
            destroy_framebuffer(self._context, self.picture)
            self.picture = None
