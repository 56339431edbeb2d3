"""The buffer of the light lists on Vulkan, in device memory."""

from __future__ import annotations

from backends.vulkan import api as vk
from common.numerics.pools import Handle

from .passes import ListBuffer


class Buffer(ListBuffer):
    """A handle of the renderer's resources; the sets of the scene hold its buffer."""

    def _created(self, size: int) -> Handle:
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
        handle: Handle = self._backend.resources.buffer(size, usage, "device", "light lists")
        return handle

    def _destroy(self, buffer: Handle) -> None:
        self._backend.resources.destroy_buffer(buffer)
