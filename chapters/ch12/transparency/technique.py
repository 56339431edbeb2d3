"""The technique of transparency: its passes, and the memory of layers that they share."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import FrameInfo, Pass, Technique
from common.errors import UnsupportedError

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from .memory import LayerMemory
from .model import check, layered
from .passes import ClearPass, CountPass, FillPass, ResolvePass, SumsPass


class TransparencyTechnique(Technique):
    """Layers of blended surfaces, composited in the order of their depth or as a weighted mean."""

    name = "transparency"
    memory: LayerMemory | None = None
    """The memory of layers, from `create` on; None if blended objects are sorted."""
    _resolve: Pass
    _drawn = False

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Create the passes. None of them is needed while blended objects are sorted.

        Raises SettingError for several samples a pixel, and UnsupportedError if the device lacks what lists need.
        """
        settings = parts.settings
        check(settings)
        memory = LayerMemory(parts, backend.part(__package__).LayerKernels(backend), backend)
        if memory.lists and (why := memory.kernels.why_not()):
            raise UnsupportedError(
                f"transparency=lists needs fragments that store their layers, but {backend.device.capabilities.device} "
                f"{why}: set transparency=weighted or sorted."
            )
        self._resolve = ResolvePass(parts, memory)
        own: tuple[Pass, ...] = (
            ClearPass(memory),
            CountPass(parts, memory),
            SumsPass(memory),
            FillPass(parts, memory),
            self._resolve,
        )
        self.passes = {it.name: it for it in own}
        self.memory = memory if layered(settings) else None

    def prepare(self, frame: FrameInfo) -> int:
        """Follow the size and the graph of the frame; nothing is written by the CPU."""
        if self.memory is None:
            return 0
        self._drawn = self._resolve in frame.passes
        if self._drawn:
            self.memory.prepare(frame.size)
        elif self.memory.is_made:
            self.memory.close()
        return 0

    @property
    def tells(self) -> bool:
        """Whether the layers of the frame are counted."""
        return self.memory is not None and self.memory.lists and self._drawn

    def told(self, slot: int) -> dict[str, int]:
        """Return the number of layers of a slot's last frame, and whether the pool was too small for them."""
        return self.memory.told(slot) if self.memory is not None else {}

    def close(self) -> None:
        """Give up the memory of layers."""
        if self.memory is not None:
            self.memory.close()
