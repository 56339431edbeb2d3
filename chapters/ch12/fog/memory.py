"""The memory of fog that all shaders of the scene see: a block for each slot, and the store; `vulkan.py` and `gl.py`
create them."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from ..frames.frame import SLOTS
from . import model
from .passes import TABLES

BOX = np.dtype([("center", np.float32, 4), ("half_size", np.float32, 4), ("albedo", np.float32, 4)])

BLOCK = np.dtype(
    [
        ("wind", np.float32, 4),
        ("history", np.float32, 4),
        ("frame", np.uint32, 4),
        ("places", np.uint32, 4),
        ("range", np.float32, 4),
        ("size", np.uint32, 4),
        ("constant", np.float32, 4),
        ("height", np.float32, 4),
        ("shape", np.float32, 4),
        ("bounds", np.float32, 4),
        ("ambient", np.float32, 4),
        ("boxes", BOX, model.MOST_BOXES),
    ]
)
"""The block of a slot (fog/scene.glsl), which std140 lays out without gaps: all of it is vectors of four."""

OF_FRAME = struct.Struct("=3f4x2f8x4I")
"""The beginning of the block that changes from frame to frame: wind, history and frame."""

CHANGING = OF_FRAME.size + 16
"""Bytes at the beginning of the block that change: places do so with the size of the picture."""


class FogMemory:
    """Blocks and store. `blocks` and `store` are part of the scene's set of bindings."""

    def __init__(self, backend: Any, table_bytes: int) -> None:
        self._backend = backend
        self.blocks = [self._create_block(f"fog, slot {slot}") for slot in range(SLOTS)]
        self._written: list[bytes] = [b""] * SLOTS
        self._mapped = [block.view(np.uint8).data for block in self.blocks]
        self.store: Any = None
        """The store, once the size of the picture is known."""
        self.tables: Any = None
        """Blue noise and noise, as froxels read them."""
        if table_bytes:
            self.tables = self._create_buffer(table_bytes, model.ranks(), "fog tables")
            for resources in backend.copies.also:
                resources[TABLES] = self.tables

    def make(self, words: int) -> None:
        """Create the store of so many words, with blue noise at its beginning."""
        self._free_store()
        self.store = self._create_buffer(words * model.WORD_BYTES, model.ranks(), "fog store")

    def write(self, slot: int, block: memoryview) -> int:
        """Write the bytes of a block to a slot: all of them once, and then what has changed; return their number."""
        content = block[:CHANGING].tobytes()
        if self._written[slot] == content:
            return 0
        size = CHANGING if self._written[slot] else BLOCK.itemsize
        self._written[slot] = content
        self._mapped[slot][:size] = block[:size]
        return size

    def _create_block(self, name: str) -> Any:
        """Return a buffer that the CPU writes and shaders read."""
        raise NotImplementedError

    def _create_buffer(self, size: int, beginning: np.ndarray, name: str) -> Any:
        """Return a buffer of the device with this content at its beginning."""
        raise NotImplementedError

    def _free_store(self) -> None:
        """Free the store, if there is one, after its last use."""
        raise NotImplementedError

    def close(self) -> None:
        """Free everything."""
        self._free_store()
