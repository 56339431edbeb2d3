"""The tone-mapping pass: from linear light to the picture that a display shows."""

from __future__ import annotations

from backends.contract import Access, Sources

from ..pipelines.description import PipelineDescription
from ..rates import passes as rates
from ..rates.native import mask_of
from ..scene.pass_parts import PassParts
from ..shading.views import tonemap_defines
from . import finish
from .fullscreen import FullscreenPass


class TonemapPass(FullscreenPass):
    """One triangle over the whole picture. Without the output `color` the renderer leaves it out."""

    name = "tonemap"
    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._tint = rates.read(parts.settings) if parts.settings.rates.rate_tint else ()
        self._texel = mask_of(parts.settings, parts.limits).texel
        self.declare()

    def declare(self) -> None:
        """Be the last pass, which also dithers and splits the view, unless FXAA follows."""
        settings = self._settings
        self._last = not finish.has_fxaa(settings) or "fxaa" not in (self.beside or ())
        self._format = "rgba8" if self._last else finish.toned_format(settings)
        self.reads = (Access("color_hdr", "sampled"), *self._tint)
        self.reads += finish.last_reads(settings) if self._last else ()
        self.writes = (Access("color" if self._last else finish.TONED, "color", format=self._format),)
        self.sources = finish.last_sources(settings) if self._last else Sources()

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/tonemap.frag"),
            defines=(
                *tonemap_defines(self._settings),
                *finish.display_defines(self._settings),
                *(finish.last_defines(self._settings, self.reads) if self._last else ()),
                *((("RATE_TEXEL", self._texel),) if self._tint else ()),
            ),
            color=self._format,
            depth=None,
            name="tonemap",
        )
