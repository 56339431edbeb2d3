"""The depth-of-field pass: the sharp picture and the blurred one become what the lens shows."""

from __future__ import annotations

from backends.contract import Access

from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from . import lens


class DepthOfFieldPass(lens.LensPass):
    """The last of the lens's three passes. Without them the picture is sharp all over."""

    name = "depth_of_field"
    reads = tuple(Access(name, "sampled") for name in ("color_hdr", "depth", "dof_blurred", "dof_near"))

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        format = parts.settings.shading.color_format
        self.writes = (Access("color_focused", "color", format=format, instead="color_hdr"),)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/depth_of_field.frag"),
            defines=lens.lens_defines(self._settings),
            color=self._settings.shading.color_format,
            depth=None,
            name="depth of field",
        )
