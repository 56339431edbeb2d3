"""What draws are made of beside their program: vertex arrays, and push constants written ahead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from backends.gl import api as gl
from backends.gl.context import PUSH_BINDING, Context
from backends.gl.resources import Buffer, create_buffer, destroy_buffer, write_buffer


class PushTable:
    """Push constants of many draws, written once: row i of an (N, bytes) array is bound for draw i.

    Rows lie at the driver's alignment of uniform buffers (16 to 256 bytes). `bind(i)` is one raw call.
    """

    def __init__(self, context: Context, rows: np.ndarray, name: str) -> None:
        raw = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
        alignment = context.limits["minUniformBufferOffsetAlignment"]
        self.size = raw.shape[1]
        self.stride = -(-max(self.size, 1) // alignment) * alignment
        padded = np.zeros((len(raw), self.stride), np.uint8)
        padded[:, : self.size] = raw
        self._context = context
        self.buffer = create_buffer(context, padded.size, "device", name)
        write_buffer(context, self.buffer, padded)

    def bind(self, index: int) -> None:
        """Make row `index` the push constants of the next draws."""
        self._context.fn.glBindBufferRange(
            gl.GL_UNIFORM_BUFFER, PUSH_BINDING, self.buffer.handle, index * self.stride, self.size
        )

    def close(self) -> None:
        """Free the buffer."""
        destroy_buffer(self._context, self.buffer)


class Stream(NamedTuple):
    """One vertex attribute of 32-bit floats: its shader location, floats per vertex, and where it begins."""

    location: int
    floats: int
    offset: int


def create_vertex_array(
    context: Context,
    streams: Sequence[Stream],
    vertices: Buffer | None,
    indices: Buffer | None,
    name: str,
) -> int:
    """Return a vertex array: tightly packed streams of one buffer, and the buffer of 32-bit indices.

    Without streams it serves shaders that make their own vertices: OpenGL draws nothing without one bound.
    """
    handle, fn = context.create("vertex array", name), context.fn
    for stream in streams:
        assert vertices is not None
        fn.glEnableVertexArrayAttrib(handle, stream.location)
        fn.glVertexArrayAttribFormat(handle, stream.location, stream.floats, gl.GL_FLOAT, 0, 0)
        fn.glVertexArrayAttribBinding(handle, stream.location, stream.location)
        fn.glVertexArrayVertexBuffer(
            handle, stream.location, vertices.handle, stream.offset, 4 * stream.floats
        )
    if indices is not None:
        fn.glVertexArrayElementBuffer(handle, indices.handle)
    return handle
