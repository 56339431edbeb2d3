"""The buffer of the light lists on OpenGL."""

from __future__ import annotations

from backends.gl.resources import create_buffer, destroy_buffer

from ..frames.backend.gl import GlBackend


class Buffer:
    """One buffer in device memory, which is bound for the whole frame."""

    def __init__(self, backend: GlBackend) -> None:
        self._backend = backend
        self.most_bytes = min(int(backend.device.limits["maxStorageBufferRange"]), 1 << 30)

    def make(self, size: int) -> None:
        """Create the buffer with `size` bytes; an earlier one is freed after its last use."""
        self.close()
        self._backend.data.light_lists = create_buffer(self._backend.device, size, "device", "light lists")

    def close(self) -> None:
        """Free the buffer."""
        data = self._backend.data
        if data.light_lists is not None:
            destroy_buffer(self._backend.device, data.light_lists)
            data.light_lists = None
