"""Frames in flight: the CPU prepares one frame while the GPU draws another.

OpenGL queues calls itself, but it does not protect mapped memory. So memory that the CPU writes for a frame exists once
per slot. The CPU writes it again only after the slot's fence is signalled: the GPU has then finished the frame.
"""

from __future__ import annotations

from backends.gl.context import Context
from backends.gl.queries import Timestamps
from backends.gl.readback import Fence

from .frame import SLOTS, FrameRing


class FrameSlot:
    """A frame slot: the timestamps of one frame in flight, and the fence after its last call."""

    def __init__(self, context: Context, index: int) -> None:
        self.index = index
        self.number = -1  # of the frame that used the slot last
        self.timestamps = Timestamps(context, f"frame slot {index}")
        self.fence: Fence | None = None

    def close(self) -> None:
        """Free the timestamps."""
        self.timestamps.close()


class Frames(FrameRing):
    """The ring of frame slots. `begin` waits for the next slot and returns it; `submit` ends the slot's calls."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.slots = [FrameSlot(context, index) for index in range(SLOTS)]

    def begin(self) -> FrameSlot:
        """Return the slot for the next frame, after the GPU has finished with it."""
        slot = self.slots[self.number % SLOTS]
        self.wait(slot)
        slot.number = self.number
        return slot

    def submit(self, slot: FrameSlot) -> None:
        """Set the fence after the frame's calls and flush them to the GPU, without waiting."""
        slot.fence = Fence(self._context)
        self._context.fn.glFlush()
        self.number += 1

    def wait(self, slot: FrameSlot) -> None:
        """Wait until the GPU has finished the frame that used `slot` last."""
        if slot.fence is not None:
            slot.fence.wait()
