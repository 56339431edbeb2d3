"""The buffer of the light lists on Vulkan."""

from __future__ import annotations

from backends.vulkan import api as vk

from ..frames.backend.vulkan import VulkanBackend


class Buffer:
    """One buffer in device memory, which the sets of the scene bind."""

    def __init__(self, backend: VulkanBackend) -> None:
        self._backend = backend
        self.most_bytes = min(int(backend.device.limits.maxStorageBufferRange), 1 << 30)

    def make(self, size: int) -> None:
        """Create the buffer with `size` bytes; an earlier one is freed after its last use."""
        self.close()
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
        data = self._backend.data
        data.light_lists = self._backend.resources.buffer(size, usage, "device", "light lists")

    def close(self) -> None:
        """Free the buffer."""
        data = self._backend.data
        if data.light_lists is not None:
            self._backend.resources.destroy_buffer(data.light_lists)
            data.light_lists = None
