"""Freezing: kernels keep the view of one frame, while the camera that draws moves on and looks at what was left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common import layouts

Bytes = NDArray[np.uint8]

CUTS = ("camera cut", "time ran backwards")
"""The reasons of frames/frame.py for a frame without history that leave a frozen view as it is."""


class CullingView:
    """The view of culling: that of the frame, or while it is frozen, that of the frame before it was frozen.

    Each slot has a copy of the view on the GPU. A frozen view is written to each of them once.
    """

    def __init__(self) -> None:
        self._last: Bytes | None = None
        self._written: set[int] = set()  # slots that hold the frozen view
        self.is_frozen = False
        """Whether this frame is culled by the view of an earlier one."""

    def release(self) -> None:
        """Let go of the view: the next frame uses its own, and that one is frozen then."""
        self._last, self.is_frozen = None, False

    def advance(self, slot: int, constants: Bytes, frozen: bool) -> Bytes | None:
        """Return the FrameConstants to write to a slot, None if it has them already.

        `constants` are those of the frame. The first frame is never frozen, since there is no view before it.
        """
        if not frozen or self._last is None:
            self.is_frozen, self._last = False, constants.copy()
            return self._last
        if not self.is_frozen:
            self.is_frozen = True
            self._written.clear()
            # What that frame saw is known by now, also if nothing was known when it began.
            record = self._last.view(layouts.dtype("FrameConstants"))
            record["valid_histories"] |= layouts.HISTORY_FRAME
        if slot in self._written:
            return None
        self._written.add(slot)
        return self._last


def without_history(constants: Bytes) -> Bytes:
    """Return FrameConstants of a frame that does not know what the frame before saw."""
    copy = constants.copy()
    copy.view(layouts.dtype("FrameConstants"))["valid_histories"] &= ~np.uint32(layouts.HISTORY_FRAME)
    return copy
