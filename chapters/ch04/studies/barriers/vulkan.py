"""The study barriers on Vulkan: images of a compiled graph, and its barriers before each pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Image

from ...graph.frame_graph import compile_graph
from ...graph.memory.vulkan_images import GraphImages, GraphMemory
from ...graph.sync.vulkan import dependency
from ...graph.types import Graph
from ..glow import declared
from ..glow.vulkan_stage import GlowStage
from ..names.vulkan import EVERYTHING
from . import STUDY, Settings


class Renderer(GlowStage):
    """The frame with the barriers that its passes need, or with one more for everything before each pass."""

    study = STUDY
    settings_class: type = Settings
    graph: Graph

    @property
    def share(self) -> bool:
        """Whether images share memory: not yet."""
        return False

    def passes_in_order(self) -> Sequence[str]:
        """Compile the frame for the sizes of this device's images, and return the order of its passes."""
        self._memory = GraphMemory(self.device)
        self.graph = compile_graph(
            declared(), self.size, requirements=self._memory.requirement, alias=self.share
        )
        self._steps = {step.name: step for step in self.graph.steps}
        self.counts = {
            "passes": len(self._steps),
            "barriers": sum(len(step.barriers) for step in self.graph.steps)
            + len(self._steps) * (self.settings.wait == "everything"),
            "transient_bytes": self.graph.memory.size,
            "transient_bytes_alone": self.graph.memory.alone,
        }
        return list(self._steps)

    def images(self) -> Mapping[str, Image]:
        """Return the images of the graph, by name."""
        images = self.keep_sized(GraphImages(self.device, self.graph, self._memory, {}), GraphImages.close)
        return images.by_name(self.graph)

    def dependency(self, name: str) -> Any:
        """Return the barriers of a step; the ones of images stay where everything waits: they change layouts, too."""
        needed = dependency(self._steps[name].barriers, self._images)
        if self.settings.wait == "needed":
            return needed
        moved = (
            []
            if needed is None
            else [*vk.ffi.unpack(needed.pImageMemoryBarriers, needed.imageMemoryBarrierCount)]
        )
        return vk.new("VkDependencyInfo", pMemoryBarriers=[EVERYTHING], pImageMemoryBarriers=moved or None)
