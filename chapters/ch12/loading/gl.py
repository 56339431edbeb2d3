"""Copies decoded textures to the GPU while frames are drawn; compare vulkan.py.

A context belongs to one thread, so only decoding runs on other threads. Decoded pixels are written to a buffer that
stays mapped (a pixel unpack buffer), and the driver copies them from there to the layer later. The call returns at
once; a fence signals when the range of the buffer is free again. The driver orders all calls.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.readback import Fence
from backends.gl.resources import FORMATS, Image, create_buffer, create_view, destroy_buffer, level_size
from backends.gl.upload import Uploader
from common.images.blocks import is_compressed

from .loading import Loading, Request, Wanted
from .ring import Ring, rows_that_fit
from .uploads import Upload, block_rows, cost, is_late

RING = 64 << 20
"""Bytes of the staging buffer. Larger images are copied in parts."""

ALIGNMENT = 16
"""The alignment of offsets: a multiple of the size of every texel and every block."""


class Owner(Protocol):
    """The owner of the images."""

    def place(self, request: Request) -> tuple[Image, int]:
        """Return the destination of a request: array and layer."""


@dataclass(eq=False)
class _Copy:
    """A texture that is being copied, up to row `row` of level `level`."""

    request: Request
    upload: Upload
    image: Image
    layer: int
    level: int = 0
    row: int = 0

    @property
    def whole(self) -> bool:
        """Whether the whole texture was copied."""
        return self.level == len(self.upload.rows)


class Loader:
    """Copies decoded textures of `loading` to the destinations that `owner` returns."""

    def __init__(self, context: Context, owner: Owner, loading: Loading, ring: int = RING) -> None:
        self._context, self._owner, self._loading, self._ring_size = context, owner, loading, ring
        self._ring: Ring | None = None
        self._fences: deque[tuple[Fence, int]] = deque()
        self._current: _Copy | None = None
        self._framed = False  # whether `advance` was called
        self.bytes = 0
        """The number of bytes copied so far."""

    def want(self, wanted: Mapping[Hashable, Wanted]) -> list[Request]:
        """Load all of `wanted` and nothing else; return the textures that have arrived (all, unless frames stream
        them).

        Raises SceneError if one cannot be decoded; textures that have arrived stay.
        """
        self._drop(self._loading.want(wanted))
        self._loading.feed()
        return [] if self._loading.streams else self.finish()

    def _drop(self, requests: list[Request]) -> None:
        if self._current is not None and self._current.request in requests:
            self._current = None

    def finish(self) -> list[Request]:
        """Load everything now and wait; return the textures that have arrived. Raises as `want` does."""
        try:
            arrived = self.advance()
            while self._loading.busy:
                if self._current is not None and self._fences:
                    self._fences[0][0].wait()
                elif not self._loading.decoded:
                    self._loading.wait()
                arrived += self.advance()
            self._loading.refuse_failed()
        except BaseException:
            self.stop()
            raise
        self._rest()
        return arrived

    def advance(self, budget: int | None = None) -> list[Request]:
        """Copy up to `budget` bytes (None: as many as fit); return the textures that have arrived.

        The first frame copies nothing, so that it is shown sooner.
        """
        loading, arrived, spent = self._loading, list[Request](), 0
        loading.feed()
        if budget is not None and loading.streams and not self._framed:
            self._framed = True
            return []
        while self._fences and self._fences[0][0].reached():
            assert self._ring is not None
            self._ring.free_to(self._fences.popleft()[1])
        while (copy := self._next()) is not None:
            left = None if budget is None else budget - spent
            if left is not None and left <= 0:
                break
            if not copy.whole:
                place = self._reserve(copy, left, spent == 0)
                if place is None:
                    break
                spent += self._write(copy, *place)
            if copy.whole:
                if is_late(copy.upload, spent, budget):
                    break
                spent += cost(copy.upload)
                self._make_mips(copy)
                self._current = None
                loading.copied(copy.request)
                loading.arrived(copy.request)
                arrived.append(copy.request)
        if spent:
            assert self._ring is not None
            self._fences.append((Fence(self._context), self._ring.head))
        elif not loading.busy:
            self._rest()
        return arrived

    def _next(self) -> _Copy | None:
        if self._current is None:
            request = self._loading.take()
            if request is not None:
                assert request.upload is not None, "what is decoded has pixels"
                self._current = _Copy(request, request.upload, *self._owner.place(request))
        return self._current

    def _reserve(self, copy: _Copy, left: int | None, first: bool) -> tuple[int, int] | None:
        """Return (offset in the ring, bytes) for as many rows as fit; None if none fits."""
        if self._ring is None:
            self._ring = Ring(self._ring_size)
            self._buffer = create_buffer(self._context, self._ring_size, "upload", "texture copies")
            self._uploader = Uploader(self._context)
        rows = copy.upload.rows[copy.level]
        count, row_bytes = rows.shape[0] - copy.row, rows.shape[1]

        def wanted(room: int, most: int | None) -> int:
            return rows_that_fit(count, row_bytes, 1, room if most is None else min(room, most)) * row_bytes

        place = self._ring.take(lambda room: wanted(room, left), ALIGNMENT)
        if place is None and first:  # the budget is less than a row: copy one row
            place = self._ring.take(lambda room: wanted(room, row_bytes), ALIGNMENT)
            if place is None and not self._ring.used:
                raise ValueError(f"{row_bytes} bytes do not fit into a ring of {self._ring.capacity}.")
        return place

    def _write(self, copy: _Copy, offset: int, nbytes: int) -> int:
        """Write rows to the ring and copy them; return their bytes."""
        rows, fn, image = copy.upload.rows[copy.level], self._context.fn, copy.image
        count, block = nbytes // rows.shape[1], block_rows(copy.upload)
        self._buffer.mapped[offset : offset + nbytes] = rows[copy.row : copy.row + count].reshape(-1)
        width, height = level_size(image, copy.level)
        y = copy.row * block
        where = (image.handle, copy.level, 0, y, copy.layer, width, min(count * block, height - y), 1)
        described, source = FORMATS[image.storage_format], gl.ffi.cast("void *", offset)
        fn.glBindBuffer(gl.GL_PIXEL_UNPACK_BUFFER, self._buffer.handle)
        if is_compressed(copy.upload.shape.format):
            fn.glCompressedTextureSubImage3D(*where, described.internal, nbytes, source)
        else:
            fn.glTextureSubImage3D(*where, described.pixels, described.component, source)
        fn.glBindBuffer(gl.GL_PIXEL_UNPACK_BUFFER, 0)
        copy.row += count
        if copy.row == rows.shape[0]:
            copy.level, copy.row = copy.level + 1, 0
        self.bytes += nbytes
        return nbytes

    def _make_mips(self, copy: _Copy) -> None:
        """Make the mip levels of one layer, through a view of that layer alone."""
        if len(copy.upload.rows) == copy.image.levels:
            return
        image = copy.image
        alone = create_view(self._context, image, image.storage_format, layer=copy.layer, layers=1)
        layer = replace(image, handle=alone, view=alone, layers=1, views=[])
        try:
            self._uploader.make_mips(layer, srgb=copy.upload.srgb)
        finally:
            image.views.remove(alone)
            self._context.destroy("texture", alone)

    def _rest(self) -> None:
        """Free the threads and the staging memory when nothing is left to load."""
        self._loading.rest()
        if self._ring is not None and not self._fences:
            self._free()

    def _free(self) -> None:
        self._uploader.close()
        destroy_buffer(self._context, self._buffer)
        self._ring = None

    def stop(self) -> None:
        """Join all threads and free everything; textures that have arrived stay."""
        self._drop(self._loading.stop())
        for fence, _ in self._fences:
            fence.wait()
        self._fences.clear()
        if self._ring is not None:
            self._free()
