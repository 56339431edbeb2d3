"""Copies of geometry to device-local memory, while the CPU goes on to build pipelines.

The CPU does not wait for these copies. Frames that read the geometry are submitted to the same queue later, after a
barrier that makes the copies visible. The staging memory is freed like resources of frames in flight: when the first
frames have ended, so have the copies. If those frames also stream textures, the memory is freed before them, since
freeing takes a driver as long as the rest of such a frame.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.vulkan.device import Device
from backends.vulkan.upload import Uploader

from ..frames.vulkan_resources import Resources


class GeometryCopies(Uploader):
    """An uploader that submits its copies at the end of `with`, and frees its memory later.

    `undo` is called if the `with` block raises, to free its objects. With `waits` the end of the block waits for the
    copies.
    """

    def __init__(
        self, device: Device, resources: Resources, undo: Callable[[], None], waits: bool = False
    ) -> None:
        super().__init__(device)
        self._resources, self._undo, self._waits = resources, undo, waits

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self.close()
            self._undo()
            return
        self.flush()
        if self._waits:
            self.close()
        else:
            self._resources.defer(self.free)
