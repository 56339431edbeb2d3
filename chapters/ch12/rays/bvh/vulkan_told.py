"""Numbers that kernels write for the CPU on Vulkan: a buffer for each slot, read when its frame is over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands

_WRITTEN = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
_READ = vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT
_WAIT = barriers(memory=(*_WRITTEN, *_READ))


class Told:
    """Storage buffers of `count` floats, one for each slot (`buffers`)."""

    def __init__(self, device: Device, count: int, name: str) -> None:
        self._device = device
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        self.buffers: list[Buffer] = [
            create_buffer(device, 4 * count, usage, "readback", f"rays: {name}, slot {slot}")
            for slot in range(SLOTS)
        ]
        self._numbers: list[NDArray[np.float32]] = [it.view(np.float32)[:count] for it in self.buffers]

    def read(self, slot: int) -> NDArray[np.float32]:
        """Return what the last frame of a slot, which is over, has written."""
        self._device.memory.invalidate(self.buffers[slot].allocation)
        return self._numbers[slot]

    @staticmethod
    def finish(commands: Commands) -> None:
        """Record that the CPU may see what was written."""
        commands.barrier(_WAIT)

    def close(self) -> None:
        """Free the buffers; no frame in flight uses them."""
        self._numbers.clear()
        while self.buffers:
            destroy_buffer(self._device, self.buffers.pop())
