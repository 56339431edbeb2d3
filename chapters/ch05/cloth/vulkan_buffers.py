"""The buffers of all cloths on the GPU: what stays, the state of the simulation, and what a frame says and is told.

What a frame says exists once per slot, and so does the answer, which the CPU reads when the slot is used again. The
rest exists once: frames of the simulation follow one another on one queue.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle

from ..frames.frame import SLOTS
from ..frames.vulkan_resources import Resources
from .layout import Packed
from .passes import FRAME, STATE

_STORAGE = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT


class ClothBuffers:
    """The buffers by name; `of(slot)` has those of a slot, too."""

    def __init__(
        self, device: Device, resources: Resources, packed: Packed, before: ClothBuffers | None = None
    ) -> None:
        self._device, self._resources = device, resources
        sizes = packed.sizes()
        self._handles: dict[str, Handle] = {}
        if before is not None:
            self._handles = {name: before._handles.pop(name) for name in STATE}
            before.close()
        new = [name for name in packed.arrays if name not in self._handles]
        for name in new:
            usage = _STORAGE | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
            self._handles[name] = resources.buffer(sizes[name], usage, "device", f"cloth {name}", shared=True)
        for name, use in FRAME.items():
            for slot in range(SLOTS):
                made = resources.buffer(sizes[name], _STORAGE, use, f"cloth {name}, slot {slot}")
                self._handles[f"{name} {slot}"] = made
        # Waited for: what was copied before it, into the pages, is then there for every queue, too.
        with Uploader(device) as uploader:
            for name in new:
                uploader.buffer(self.buffer(name), packed.arrays[name])

    def buffer(self, name: str, slot: int = 0) -> Buffer:
        """Return a buffer by its name, where there are several that of a slot."""
        return self._resources.buffers.get(self._handles[f"{name} {slot}" if name in FRAME else name])

    def stats(self, slot: int) -> NDArray[np.uint8]:
        """Return the bytes that the last frame of a slot wrote about each cloth."""
        held = self.buffer("stats", slot)
        return held.mapped[: held.size].copy()

    def read(self, name: str) -> NDArray[np.float32]:
        """Return what is in a buffer that stays; all frames must be over."""
        held = self.buffer(name)
        usage = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        copied = create_buffer(self._device, held.size, usage, "readback", f"cloth {name}, read")
        try:
            with submit_once(self._device) as commands:
                region = vk.new("VkBufferCopy", size=held.size)
                self._device.fn.vkCmdCopyBuffer(commands, held.handle, copied.handle, 1, region)
                self._device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            self._device.memory.invalidate(copied.allocation)
            found: NDArray[np.float32] = copied.view(np.float32).copy()
            return found
        finally:
            destroy_buffer(self._device, copied)

    def write(self, slot: int, arrays: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write what a frame asks for."""
        for name, data in arrays.items():
            self.buffer(name, slot).mapped[: data.size] = data

    def close(self) -> None:
        """Give the buffers up; frames in flight may still use them."""
        for handle in self._handles.values():
            self._resources.destroy_buffer(handle)
        self._handles = {}
