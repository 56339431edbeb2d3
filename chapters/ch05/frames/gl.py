"""Frames in flight: the CPU prepares one frame while the GPU draws another.

OpenGL queues calls by itself, but mapped memory it does not protect: whatever the CPU writes for a frame exists once
per slot, and a slot's fence tells when the GPU has left it.
"""

from __future__ import annotations

from backends.gl.context import Context
from backends.gl.queries import Timestamps
from backends.gl.readback import Fence

from .frame import SLOTS, FrameRing


class FrameSlot:
    """What belongs to one frame in flight: its timestamps, and the fence behind its last call."""

    def __init__(self, context: Context, index: int) -> None:
        self.index = index
        self.number = -1  # of the frame that used the slot last
        self.timestamps = Timestamps(context, f"frame slot {index}")
        self.fence: Fence | None = None

    def close(self) -> None:
        """Free the timestamps."""
        self.timestamps.close()


class Frames(FrameRing):
    """The ring of slots. `begin` gives the next slot once the GPU has left it, `submit` ends its calls."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.slots = [FrameSlot(context, index) for index in range(SLOTS)]

    def begin(self) -> FrameSlot:
        """Return the slot for the next frame."""
        slot = self.slots[self.number % SLOTS]
        self.wait(slot)
        slot.number = self.number
        return slot

    def submit(self, slot: FrameSlot) -> None:
        """Note that the frame's calls are made, and send them off; nothing is waited for."""
        slot.fence = Fence(self._context)
        self._context.fn.glFlush()
        self.number += 1

    def wait(self, slot: FrameSlot) -> None:
        """Wait until the GPU has finished the frame that used `slot` last."""
        if slot.fence is not None:
            slot.fence.wait()
