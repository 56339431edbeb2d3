"""The study dynamic-resolution on Vulkan: timestamps of each prepared frame, and what waits for a window."""

from __future__ import annotations

from typing import Any

from ...frames.vulkan_profiler import Profiler
from .prepared import Prepared
from .renderer import Scaled


class Renderer(Scaled):
    """The frame at eight scales, on Vulkan."""

    PARTS = (*Scaled.PARTS, "profiler")

    def _renew(self) -> None:
        api: Any = self._api
        api.profiler = Profiler(self.device)

    def _free_renewed(self, prepared: Prepared) -> None:
        prepared.parts["profiler"].close()

    def _wait(self) -> None:
        self.device.wait_idle()
