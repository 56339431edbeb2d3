"""The last step of a frame on Vulkan."""

from __future__ import annotations

from backends.vulkan.device import Device
from backends.vulkan.readback import Readback
from backends.vulkan.resources import Image

from .outputs import OutputCopies
from .vulkan_commands import Commands


class CopyOutputs(OutputCopies):
    """Copies outputs, and leaves them as a window copies them; the graph brings them into that layout."""

    def __init__(self, device: Device) -> None:
        super().__init__()
        self._device = device

    def _readback(self, image: Image, name: str) -> Readback:
        return Readback(self._device, image, name)

    def record(self, commands: Commands) -> None:
        """Record the copies."""
        for readback in self.readbacks[commands.slot.index].values():
            readback.record(commands.handle)
