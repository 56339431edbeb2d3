"""The study names on Vulkan: an image for each name, and a barrier for everything before each pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Image, create_image, destroy_image

from ..glow import FORMAT, Pass, passes, size_of
from ..glow.vulkan_stage import GlowStage
from . import STUDY, Settings, frame

EVERYTHING = {
    "srcStageMask": vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
    "srcAccessMask": vk.VK_ACCESS_2_MEMORY_WRITE_BIT,
    "dstStageMask": vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
    "dstAccessMask": vk.VK_ACCESS_2_MEMORY_READ_BIT | vk.VK_ACCESS_2_MEMORY_WRITE_BIT,
}
"""All later work waits for all earlier work, and sees all that it wrote."""


class Renderer(GlowStage):
    """The frame in an order that follows from its names."""

    study = STUDY
    settings_class: type = Settings

    def described(self) -> Mapping[str, Pass]:
        """Return the declared passes by name."""
        return passes(self.settings.show)

    def passes_in_order(self) -> Sequence[str]:
        """Return the order of the passes."""
        ordered, wiring = frame(self.settings)
        self.counts = {
            "passes": len(ordered),
            "passes_skipped": len(wiring.left_out),
            "barriers": len(ordered),
        }
        return ordered

    def images(self) -> Mapping[str, Image]:
        """Return an image of its own for each name."""
        written = [self.passes_by_name[name] for name in self._order if self.passes_by_name[name].writes]
        return {
            described.writes: self._image(described.writes, size_of(described, self.size))
            for described in written
        }

    def _image(self, name: str, size: tuple[int, int]) -> Image:
        image = create_image(self.device, FORMAT, size, self.graphics.target_usage("color", 1), name)
        return self.keep_sized(image, lambda image: destroy_image(self.device, image))

    def dependency(self, name: str) -> Any:
        """Return the barrier for everything, which also moves the images of a pass to the layouts that it needs."""
        moved = [
            self._moved(source, vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL) for source in self._new(name)
        ]
        if target := self.passes_by_name[name].writes:
            moved.append(self._moved(target, vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL))
        return vk.new("VkDependencyInfo", pMemoryBarriers=[EVERYTHING], pImageMemoryBarriers=moved or None)

    def _new(self, name: str) -> list[str]:
        """Return what no pass before this one has read: these images are in the layout of their writer."""
        before = self._order[: self._order.index(name)]
        read = {source for other in before for source in self.passes_by_name[other].reads}
        return [source for source in self.passes_by_name[name].reads if source not in read]

    def _moved(self, name: str, layout: int) -> dict[str, Any]:
        image = self._images[name]
        # A target's old contents are lost: "undefined" accepts an image in any layout.
        before = vk.VK_IMAGE_LAYOUT_UNDEFINED
        if layout == vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL:
            before = vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL
        return {
            **EVERYTHING,
            "oldLayout": before,
            "newLayout": layout,
            "srcQueueFamilyIndex": vk.VK_QUEUE_FAMILY_IGNORED,
            "dstQueueFamilyIndex": vk.VK_QUEUE_FAMILY_IGNORED,
            "image": image.handle,
            "subresourceRange": {"aspectMask": image.aspect, "levelCount": 1, "layerCount": 1},
        }
