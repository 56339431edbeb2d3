"""The circle-of-confusion pass: how far each pixel spreads that is out of focus, beside its light at half the size."""

from __future__ import annotations

from backends.contract import Access

from ..pipelines.description import PipelineDescription
from . import lens


class CircleOfConfusionPass(lens.LensPass):
    """First of the lens's three passes. A transparent surface has no depth, and is as sharp as the one behind it."""

    name = "circle_of_confusion"
    reads = (Access("color_hdr", "sampled"), Access("depth", "sampled"))
    writes = (
        Access("dof_half", "color", format=lens.FORMAT, scale=0.5),
        Access("dof_part", "color", format=lens.PART_FORMAT, scale=0.5),
    )

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/circle_of_confusion.frag"),
            defines=lens.lens_defines(self._settings),
            color=(lens.FORMAT, lens.PART_FORMAT),
            depth=None,
            name="circle of confusion",
        )
