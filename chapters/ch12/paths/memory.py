"""What paths read besides the scene: a block for each slot, and the tables; `vulkan.py` and `gl.py` create them."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames.frame import SLOTS
from .model import CELLS, Tables
from .passes import BLOCK_BYTES, FRAME, GROUPS, TABLES, TOLD

BLOCK = struct.Struct("=4I4I4I4f4I4I")
"""The block of paths/frame.glsl, BLOCK_BYTES long."""


class PathMemory:
    """Blocks and tables, bound to the pass by the names of the graph."""

    def __init__(self, backend: Any, tables: Tables) -> None:
        self._backend = backend
        self.blocks = [self._create_block(BLOCK_BYTES, f"paths, slot {slot}") for slot in range(SLOTS)]
        self._mapped = [block.view(np.uint8).data for block in self.blocks]
        self.tables: Any = self._create_tables(tables.words)
        self.room = tables.words.nbytes
        """Bytes of the tables: those of the scene when it was opened."""
        self._told = [
            self._create_told(16 * GROUPS, f"errors of paths, slot {slot}") for slot in range(SLOTS)
        ]
        for slot, resources in enumerate(backend.copies.also):
            resources |= {TABLES: self.tables, FRAME: self.blocks[slot], TOLD: self._told[slot]}
        self._tables = tables

    def follow(self, tables: Tables) -> None:
        """Have other tables from now on, of `room` bytes at most."""
        self._tables = tables
        self._write_tables(self.tables, tables.words)

    def write(
        self,
        slot: int,
        samples: tuple[int, int, int, int],
        knobs: tuple[int, int, int, int],
        choice: tuple[float, float],
        crop: tuple[int, int, int, int],
    ) -> int:
        """Write the block of a slot, by the members of paths/frame.glsl; return the bytes written.

        `choice` are the part of the rays that goes to the environment, and the error at which pixels are done.
        """
        BLOCK.pack_into(
            self._mapped[slot],
            0,
            *samples,
            *self._tables.places,
            *knobs,
            *(choice[0], float(CELLS), choice[1] ** 2, 0.0),
            *self._tables.tree_places,
            *crop,
        )
        return BLOCK_BYTES

    def told(self, slot: int) -> NDArray[np.float64]:
        """Return the sums (4,) that the last frame of a slot, which is over, wrote (paths/tell.comp)."""
        sums: NDArray[np.float64] = self._read(self._told[slot]).reshape(-1, 4).sum(axis=0, dtype=np.float64)
        return sums

    def _create_block(self, size: int, name: str) -> Any:
        """Return a buffer that the CPU writes and shaders read."""
        raise NotImplementedError

    def _create_tables(self, words: NDArray[np.uint32]) -> Any:
        """Return a buffer of the device with this content."""
        raise NotImplementedError

    def _write_tables(self, buffer: Any, words: NDArray[np.uint32]) -> None:
        """Write other content into it, after frames in flight."""
        raise NotImplementedError

    def _create_told(self, size: int, name: str) -> Any:
        """Return a buffer that shaders write and the CPU reads."""
        raise NotImplementedError

    def _read(self, buffer: Any) -> NDArray[np.float32]:
        """Return the floats of such a buffer."""
        raise NotImplementedError

    def finish(self) -> None:
        """Make what shaders stored visible to the CPU."""

    def close(self) -> None:
        """Free everything."""
