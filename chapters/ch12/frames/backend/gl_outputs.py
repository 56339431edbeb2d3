"""The last step of a frame on OpenGL: copies of its outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.gl.context import Context
from backends.gl.readback import Readback
from backends.gl.resources import Image
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer

from ...graph.types import Graph
from ..gl_commands import Commands
from .outputs import OutputCopies


class CopyOutputs(OutputCopies):
    """Copies outputs, and holds the framebuffer from which a window copies the picture."""

    def __init__(self, context: Context) -> None:
        super().__init__()
        self._context = context
        self.picture: Framebuffer | None = None
        """The picture, for a window."""

    def attach(self, graph: Graph, images: Any) -> list[Mapping[str, Any]]:
        """Create the buffers for a graph's outputs, and the framebuffer; return the buffers by slot."""
        buffers = super().attach(graph, images)
        if "color" in graph.names:
            color = images.image(0, graph.names["color"])
            self.picture = create_framebuffer(self._context, [color], None, "picture")
        return buffers

    def _readback(self, image: Image, name: str) -> Readback:
        return Readback(self._context, image, name)

    def record(self, commands: Commands) -> None:
        """Make the copies; the graph has already set the barrier that they need."""
        for readback in self.readbacks[commands.slot.index].values():
            readback.copy()

    def close(self) -> None:
        """Free the buffers and the framebuffer."""
        super().close()
        if self.picture is not None:
            destroy_framebuffer(self._context, self.picture)
            self.picture = None
