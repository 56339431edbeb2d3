"""The tone-mapping pass: from linear light to the picture that a display shows."""

from __future__ import annotations

from backends.contract import Access, Sources

from ..pipelines.description import PipelineDescription
from ..rates import passes as rates
from ..rates.native import mask_of
from ..scene.pass_parts import PassParts
from ..shading.views import tonemap_defines
from .fullscreen import FullscreenPass


class TonemapPass(FullscreenPass):
    """One triangle over the whole picture. Without the output `color` the renderer leaves it out."""

    name = "tonemap"
    sources = Sources()
    writes = (Access("color", "color", format="rgba8"),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._tint = rates.read(parts.settings) if parts.settings.rates.rate_tint else ()
        self._texel = mask_of(parts.settings, parts.limits).texel
        self.reads = (Access("color_hdr", "sampled"), *self._tint)

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/tonemap.frag"),
            defines=(
                *tonemap_defines(self._settings),
                *((("RATE_TEXEL", self._texel),) if self._tint else ()),
            ),
            color="rgba8",
            depth=None,
            name="tonemap",
        )
