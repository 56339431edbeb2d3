"""The pages and the buffers of reports on OpenGL; compare vulkan.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import (
    Buffer,
    Image,
    MemoryUse,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    write_buffer,
)
from common.errors import DeviceError

from .memory import Pages as _Pages
from .memory import ReportMemory as _ReportMemory


class Pages(_Pages):
    """An image that this object owns."""

    def _create(self, size: tuple[int, int]) -> Image:
        context = self._backend.device
        context.fn.glGetError()  # of an earlier call
        image = create_image(context, "r32f", size, "shadow pages", shape="array", layers=1)
        code = context.fn.glGetError()
        if code != gl.GL_NO_ERROR:  # no memory, which no later call would say
            destroy_image(context, image)
            raise DeviceError(gl.describe("glTextureStorage3D", size, code))
        return image

    def close(self) -> None:
        """Free the image; OpenGL itself waits for its last use."""
        destroy_image(self._backend.device, self.image)


def make_pages(backend: Any, tiles: int, words: int, sparse: bool) -> _Pages:
    """Return the pages for a table of some words: `tiles` of memory. No place can be without any (`sparse`)."""
    return Pages(backend, tiles)


class ReportMemory(_ReportMemory):
    """Buffers that this object owns."""

    _buffers: list[Buffer]

    def _create(self, words: int, use: MemoryUse, name: str) -> Buffer:
        buffer = create_buffer(self._backend.device, 4 * words, use, name)
        self._buffers = [*getattr(self, "_buffers", []), buffer]
        return buffer

    def _clear(self, buffer: Buffer) -> None:
        write_buffer(self._backend.device, buffer, np.zeros(self._words, np.uint32))

    def _read(self, buffer: Buffer) -> NDArray[np.uint32]:
        words: NDArray[np.uint32] = buffer.view(np.uint32)[: self._words].copy()
        return words

    def finish(self) -> None:
        """Set a barrier: the graph knows no memory of the CPU."""
        self._backend.device.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def close(self) -> None:
        """Free the buffers."""
        while self._buffers:
            destroy_buffer(self._backend.device, self._buffers.pop())
