"""The buffer of the light lists on OpenGL, in device memory."""

from __future__ import annotations

from backends.gl import resources

from .passes import ListBuffer


class Buffer(ListBuffer):
    """A buffer that is bound at the beginning of a frame."""

    def _created(self, size: int) -> resources.Buffer:
        return resources.create_buffer(self._backend.device, size, "device", "light lists")

    def _destroy(self, buffer: resources.Buffer) -> None:
        resources.destroy_buffer(self._backend.device, buffer)
