"""The buffers that the kernels count in; `vulkan.py` and `gl.py` create them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...frames.frame import SLOTS
from .layout import HEAD, HEAD_BYTES, TOLD, TOLD_WORDS


class WaveMemory:
    """The head, which is the GPU's alone, and a copy of its counters for each slot, by their names in the graph."""

    def __init__(self, backend: Any) -> None:
        self._backend = backend
        self.head = self._create_head(HEAD_BYTES)
        self._told = [self._create_told(4 * TOLD_WORDS, f"live paths, slot {slot}") for slot in range(SLOTS)]
        for slot, resources in enumerate(backend.copies.also):
            resources |= {HEAD: self.head, TOLD: self._told[slot]}

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters (TOLD_WORDS,) of the last frame of a slot, which is over."""
        return self._read(self._told[slot])[:TOLD_WORDS]

    def _create_head(self, size: int) -> Any:
        """Return a buffer that shaders write, and that has arguments of dispatches."""
        raise NotImplementedError

    def _create_told(self, size: int, name: str) -> Any:
        """Return a buffer that shaders write and the CPU reads."""
        raise NotImplementedError

    def _read(self, buffer: Any) -> NDArray[np.uint32]:
        """Return the words of such a buffer."""
        raise NotImplementedError

    def close(self) -> None:
        """Free everything."""
