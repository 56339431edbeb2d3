"""The buffers of the exposure, one block a slot; `vulkan.py` and `gl.py` create them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..frames.frame import SLOTS
from . import model

BLOCK_BYTES = 32
"""Two vectors: what the CPU writes, and what the kernel of the frame before wrote (exposure.glsl)."""

HISTOGRAM_BYTES = 2 * 4 * model.BINS

NEXT, TOLD = "exposure_next", "exposure_told"
"""The names of the other slot's block, and of the copy that the CPU can read."""


class ExposureMemory:
    """The exposure of each slot. `blocks` are part of the scene's set of bindings.

    Without automatic exposure a slot has 32 bytes, and the CPU writes half of them. With it the kernel writes the other
    half for the other slot, and 16 bytes that the CPU reads if an output asks for luminance in nits.
    """

    def __init__(self, backend: Any, mode: str) -> None:
        self._backend, self.mode = backend, mode
        self.blocks = [self._create(BLOCK_BYTES, "upload", f"exposure, slot {slot}") for slot in range(SLOTS)]
        self._written: list[tuple[float, float, bool] | None] = [None] * SLOTS
        self.told: list[Any] = []
        self.tells = [False] * SLOTS
        """Whether the last frame of each slot tells its exposure."""
        if not mode:
            return
        self.told = [self._create(16, "readback", f"exposure told, slot {slot}") for slot in range(SLOTS)]
        for slot, resources in enumerate(backend.copies.also):
            resources |= {NEXT: self.blocks[1 - slot], TOLD: self.told[slot]}
        if mode == "histogram":
            histogram = self._create(HISTOGRAM_BYTES, "device", "histogram")
            for resources in backend.copies.also:
                resources["histogram"] = histogram
            self._clear(histogram)

    def write(self, slot: int, exposure: float, before: float, adapted: bool) -> int:
        """Write what the CPU knows of a slot's frame, if it is new; return the bytes written."""
        values = exposure, before, adapted
        if self._written[slot] == values:
            return 0
        self._written[slot] = values
        self.blocks[slot].view(np.float32)[:4] = (*values, 0.0)
        return 16

    def of_frame(self, slot: int, of_view: float) -> float:
        """Return the exposure of the last frame of a slot, which is over; `of_view` is that of its view."""
        return float(self._read(self.told[slot])[0]) if self.tells[slot] else of_view

    def _create(self, size: int, use: Any, name: str) -> Any:
        """Return a buffer for shaders."""
        raise NotImplementedError

    def _clear(self, buffer: Any) -> None:
        """Fill a buffer with zeros."""
        raise NotImplementedError

    def _read(self, buffer: Any) -> np.ndarray:
        """Return the floats of a buffer that the GPU wrote."""
        raise NotImplementedError

    def finish(self) -> None:
        """Make what the last kernel stored visible to the CPU and to uniform blocks of the next frame."""

    def close(self) -> None:
        """Free the buffers."""
