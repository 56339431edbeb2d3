"""Getting images back to the CPU: copies into mapped memory, and their pixels as numpy, row 0 on top."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import FORMATS, Image, create_buffer, destroy_buffer, level_size
from common.errors import DeviceError
from common.images.packed import unpacked

MOST_BYTES = 1 << 30
"""What one call copies at most: it takes the number of bytes as 31 bits."""


class Fence:
    """A place in the stream of calls: made by `Fence(context)`, reached when the GPU has done all calls before it."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._handle: Any = context.fn.glFenceSync(gl.GL_SYNC_GPU_COMMANDS_COMPLETE, 0)

    def reached(self) -> bool:
        """Whether the GPU has got here; asks without waiting."""
        return self._ask(0)

    def wait(self) -> None:
        """Wait until the GPU has got here; a second time costs nothing."""
        while not self._ask(10**9):
            pass

    def _ask(self, nanoseconds: int) -> bool:
        if self._handle is None:
            return True
        fn = self._context.fn
        answer = fn.glClientWaitSync(self._handle, gl.GL_SYNC_FLUSH_COMMANDS_BIT, nanoseconds)
        if answer == gl.GL_TIMEOUT_EXPIRED:
            return False
        fn.glDeleteSync(self._handle)
        self._handle = None
        if answer == gl.GL_WAIT_FAILED:
            raise DeviceError("glClientWaitSync failed: the GPU was lost or reset.")
        return True

    def close(self) -> None:
        """Forget the fence."""
        if self._handle is not None:
            self._context.fn.glDeleteSync(self._handle)
            self._handle = None


class Readback:
    """A buffer of the size of one image, with all slices of a 3D one.

    `record` copies the image into it, `read` returns it once a fence says so.
    """

    def __init__(self, context: Context, image: Image, name: str) -> None:
        self._context, self._image = context, image
        self._format = FORMATS[image.format]
        slices = (image.layers,) if image.shape == "3d" else ()
        self._shape = (*slices, image.height, image.width)
        self.buffer = create_buffer(context, math.prod(self._shape) * self._format.texel, "readback", name)

    def record(self) -> None:
        """Copy level 0 of the image into the buffer; nothing is waited for."""
        fn = self._context.fn
        # What shaders stored to the image is not in order with copies by itself, nor are copies with mapped memory.
        fn.glMemoryBarrier(gl.GL_TEXTURE_UPDATE_BARRIER_BIT | gl.GL_FRAMEBUFFER_BARRIER_BIT)
        self.copy()
        fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def copy(self) -> None:
        """Do so without barriers: where it is known that no shader stored to the image, or one stands in front."""
        fn = self._context.fn
        fn.glBindBuffer(gl.GL_PIXEL_PACK_BUFFER, self.buffer.handle)
        slices = self._image.layers if self._image.shape == "3d" else 1
        _copy(self._context, self._image, 0, 0, gl.NULL, slices)
        fn.glBindBuffer(gl.GL_PIXEL_PACK_BUFFER, 0)

    def read(self) -> np.ndarray:
        """Return a copy of the image as (H, W) or (H, W, C), row 0 on top; a fence after `record` must be reached.

        A 3D image has its slices in front: (D, H, W, C).
        """
        count = math.prod(self._shape) * self._format.channels
        values = self.buffer.view(self._format.dtype)[:count]
        pixels = values.reshape(_shaped(self._shape, self._format.channels)).copy()
        return unpacked(pixels, self._image.format)

    def close(self) -> None:
        """Free the buffer."""
        destroy_buffer(self._context, self.buffer)


def read_image(context: Context, image: Image, *, level: int = 0, layer: int = 0) -> np.ndarray:
    """Return a level of a layer now, waiting for the GPU: (H, W) or (H, W, C), row 0 on top. For tests and tools."""
    described = FORMATS[image.format]
    width, height = level_size(image, level)
    values: np.ndarray = np.empty(_shaped((height, width), described.channels), described.dtype)
    context.fn.glMemoryBarrier(gl.GL_TEXTURE_UPDATE_BARRIER_BIT | gl.GL_FRAMEBUFFER_BARRIER_BIT)
    _copy(context, image, level, layer, gl.pointer(values))
    return unpacked(values, image.format)


def _copy(context: Context, image: Image, level: int, layer: int, where: Any, slices: int = 1) -> None:
    """Copy a level of layers one behind the other, to the address or the place in the bound buffer `where`."""
    described = FORMATS[image.format]
    width, height = level_size(image, level)
    row = width * described.channels * np.dtype(described.dtype).itemsize
    deep, rows = slices, height
    if slices * height * row > MOST_BYTES:
        deep, rows = 1, max(MOST_BYTES // row, 1)
    begin = int(gl.ffi.cast("uintptr_t", where))
    for z in range(0, slices, deep):
        for y in range(0, height, rows):
            count = min(rows, height - y)
            context.fn.glGetTextureSubImage(
                image.view,
                level,
                *(0, y, layer + z),
                *(width, count, deep),
                described.pixels,
                described.component,
                deep * count * row,
                gl.ffi.cast("void *", begin + (z * height + y) * row),
            )


def _shaped(size: tuple[int, ...], channels: int) -> tuple[int, ...]:
    return size if channels == 1 else (*size, channels)
