"""Geometry on its way to memory that is the GPU's alone, while the CPU goes on to build pipelines.

Nobody waits for these copies. Frames that read them are submitted to the same queue later, behind a barrier that makes
the copies visible to all that follows; and what they are copied from is freed like everything that a frame in flight
may use: when the first frames are over, the copies before them are, too.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.vulkan.device import Device
from backends.vulkan.upload import Uploader

from .resources import Resources


class GeometryCopies(Uploader):
    """An uploader that is left to itself: its copies are submitted at the end of `with`, and its memory freed later.

    `undo` is called if what stands within fails: nobody else could free then what was begun there.
    """

    def __init__(self, device: Device, resources: Resources, undo: Callable[[], None]) -> None:
        super().__init__(device)
        self._resources, self._undo = resources, undo

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self.close()
            self._undo()
            return
        self.flush()
        self._resources.defer(self.free)
