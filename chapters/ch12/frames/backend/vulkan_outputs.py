"""The last step of a frame on Vulkan: copies of its outputs."""

from __future__ import annotations

from backends.vulkan.device import Device
from backends.vulkan.readback import Readback
from backends.vulkan.resources import Image

from ..vulkan_commands import Commands
from .outputs import OutputCopies


class CopyOutputs(OutputCopies):
    """Copies outputs. The graph brings the images into the layout for copies, which a window needs, too."""

    def __init__(self, device: Device) -> None:
        super().__init__()
        self._device = device

    def _readback(self, image: Image, name: str) -> Readback:
        return Readback(self._device, image, name)

    def record(self, commands: Commands) -> None:
        """Record the copies."""
        for readback in self.readbacks[commands.slot.index].values():
            readback.record(commands.handle)
