"""The circle-of-confusion pass: how far each pixel spreads that is out of focus, beside its light at half the size."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.vulkan import GraphicsPipeline
from ..settings import Settings
from . import lens
from .vulkan_fullscreen import FullscreenPass


class CircleOfConfusionPass(FullscreenPass):
    """The first of the lens's three passes. What is transparent has no depth, and is as sharp as what is behind it."""

    name = "circle_of_confusion"
    reads = (Access("color_hdr", "sampled"), Access("depth", "sampled"))
    writes = (
        Access("dof_half", "color", format=lens.FORMAT, scale=0.5),
        Access("dof_part", "color", format=lens.PART_FORMAT, scale=0.5),
    )

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the lens has an opening, and there is anything before it."""
        return lens.needed(scene, settings)

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline."""
        return GraphicsPipeline(
            shaders=("post/fullscreen.vert", "post/circle_of_confusion.frag"),
            defines=lens.lens_defines(self._settings),
            color=(lens.FORMAT, lens.PART_FORMAT),
            depth=None,
            name="circle of confusion",
        )
