"""The tone-mapping pass: from linear light to the picture that a display shows."""

from __future__ import annotations

from backends.contract import Access, Sources

from ..pipelines.description import PipelineDescription
from ..shading.views import tonemap_defines
from .fullscreen import FullscreenPass


class TonemapPass(FullscreenPass):
    """One triangle over the whole picture. Without the output `color` the renderer leaves it out."""

    name = "tonemap"
    sources = Sources()
    reads = (Access("color_hdr", "sampled"),)
    writes = (Access("color", "color", format="rgba8"),)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/tonemap.frag"),
            defines=tonemap_defines(self._settings),
            color="rgba8",
            depth=None,
            name="tonemap",
        )
