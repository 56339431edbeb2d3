"""The image of the pages, and the buffers of reports: one that kernels write, and a copy for the CPU in each slot.

`vulkan.py`, `gl.py` and `vulkan_sparse.py` create them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames.frame import SLOTS
from ..shadows.layout import pages_size
from ..shadows.model import TILE, TILE_BYTES
from .pool import TilePool

NEEDS = ("shadow_needs", "shadow_needs_boxes", "shadow_needs_told")
"""The names of the report, by the passes that write it."""

NEEDS_OF_FOG = "shadow_needs_fog"
"""The name of the report where froxels write it first (fog/scatter.comp)."""

TOLD = "shadow_told"
"""The name of the CPU's copy."""


class Pages:
    """An image of R32F with one layer, whose tiles all have memory. The table alone says which faces they belong to."""

    virtual: NDArray[np.uint32] | None = None
    """The places of words and tiles, where tiles are bound to places (pool.py)."""

    image: Any

    def __init__(self, backend: Any, tiles: int) -> None:
        self._backend = backend
        self.tiles = tiles
        self.columns_rows = columns, rows = pages_size(tiles)
        """Columns and rows of tiles."""
        self.image = self._create((columns * TILE, rows * TILE))

    def _create(self, size: tuple[int, int]) -> Any:
        """Return the image."""
        raise NotImplementedError

    def reserve(self, tiles: int) -> int:
        """Have memory for so many tiles, or for as many as the device gives; return their number."""
        return self.tiles

    def bind(self, pool: TilePool) -> None:
        """Let the places of words that have other tiles show these, before the next frame."""

    def bytes(self, pool: TilePool) -> int:
        """Return the bytes of memory."""
        return self.columns_rows[0] * self.columns_rows[1] * TILE_BYTES

    def close(self) -> None:
        """Free the image."""
        raise NotImplementedError


class ReportMemory:
    """The report of each slot's frame."""

    def __init__(self, backend: Any, words: int) -> None:
        self._backend, self._words = backend, words
        self.asked: Callable[[int, int], tuple[Any, int]]
        """Returns the buffer of a slot, and the byte of it at which the work groups of a pass begin."""
        needs = self._create(words, "device", NEEDS[0])
        self._clear(needs)
        self._told = [self._create(words, "readback", f"{TOLD}, slot {slot}") for slot in range(SLOTS)]
        for resources, told in zip(backend.copies.also, self._told, strict=True):
            resources |= {NEEDS[0]: needs, NEEDS_OF_FOG: needs, TOLD: told}
        self._reports = [False] * SLOTS

    def read(self, slot: int) -> NDArray[np.uint32] | None:
        """Return the report of the slot's last frame, if there is one."""
        return self._read(self._told[slot]) if self._reports[slot] else None

    def ask(self, slot: int, wanted: bool) -> None:
        """Note whether the slot's next frame reports."""
        self._reports[slot] = wanted

    def forget(self) -> None:
        """Read no report of a frame before this moment."""
        self._reports = [False] * SLOTS

    def _create(self, words: int, use: Any, name: str) -> Any:
        """Return a buffer for shaders."""
        raise NotImplementedError

    def _clear(self, buffer: Any) -> None:
        """Fill a buffer with zeros."""
        raise NotImplementedError

    def _read(self, buffer: Any) -> NDArray[np.uint32]:
        """Return the words of a buffer that the GPU wrote."""
        raise NotImplementedError

    def finish(self) -> None:
        """Make what the last kernel stored visible to the CPU."""

    def close(self) -> None:
        """Free the buffers."""
