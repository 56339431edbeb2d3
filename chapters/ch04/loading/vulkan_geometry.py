"""Geometry on its way to memory that is the GPU's alone, while the CPU goes on to build pipelines.

Nobody waits for these copies. Frames that read them are submitted to the same queue later, behind a barrier that makes
the copies visible to all that follows; and what they are copied from is freed like everything that a frame in flight
may use: when the first frames are over, the copies before them are, too. Only where those frames have textures to load
it is freed before: a driver takes as long for that as they take for all else.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.vulkan.device import Device
from backends.vulkan.upload import Uploader

from ..frames.vulkan_resources import Resources


class GeometryCopies(Uploader):
    """An uploader that is left to itself: its copies are submitted at the end of `with`, and its memory freed later.

    `undo` is called if what stands within fails: nobody else could free then what was begun there. With `waits` the
    copies are waited for.
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
