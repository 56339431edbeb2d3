"""Shading rates for fragments on a device without them: light is drawn twice, each time where the mask has its rate.

rates -> rate_depth -> block_depth         a pixel for each block: 0 where it is to be lit, 1 elsewhere
         lighting_blocks -> color_blocks   lit where block_depth lets a fragment pass
rates -> rate_spread -> color_spread       a coarse texel has its blocks' light
                        pixel_depth        0 where the rate is 1x1, 1 elsewhere
         lighting_pixels -> color_lit      lit where pixel_depth lets a fragment pass

The depth test stands for a stencil test: both are done before the shader, and a depth of one float needs no new format.
The depth is reversed, as everywhere: the triangle of a full screen lies at 0, and passes where the depth is 0.
"""

from __future__ import annotations

from dataclasses import replace

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.lighting import LightingPass
from . import model
from .passes import by_blocks, read

_BLOCK_DEPTH, _PIXEL_DEPTH, _BLOCKS, _SPREAD = "block_depth", "pixel_depth", "color_blocks", "color_spread"


class MaskedPass(FullscreenPass):
    """The common base of passes that turn the mask into a depth: what they draw passes everywhere, and writes it.

    Nothing of the scene is read. But its textures are bound once in a frame on OpenGL, and lighting reads them next.
    """

    shader: str
    color: str | None = None

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = read(parts.settings)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether fragments light by blocks."""
        return by_blocks(settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline of the triangle."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", self.shader),
            defines=(
                ("RATE_TEXEL", model.texel_of(self._settings)),
                ("COARSE", f"{model.coarse_code(self._settings)}u"),
            ),
            color=self.color,
            depth="write",
            name=self.name,
        )


class RateDepthPass(MaskedPass):
    """Says for each block whether it is to be lit."""

    name, shader = "rate_depth", "rates/depth.frag"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        block = model.decode(model.coarse_code(parts.settings))
        self.writes = (Access(_BLOCK_DEPTH, "depth", format="d32f", clear=(0.0,), texel=block),)


class RateSpreadPass(MaskedPass):
    """Copies the light of blocks to their pixels, and says for each pixel whether it is to be lit."""

    name, shader = "rate_spread", "rates/spread.frag"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.color = parts.settings.shading.color_format
        self.reads = (*self.reads, Access(_BLOCKS, "sampled"))
        self.writes = (
            Access(_SPREAD, "color", format=self.color),
            Access(_PIXEL_DEPTH, "depth", format="d32f", clear=(0.0,)),
        )


class BlockLightingPass(LightingPass):
    """Lights one pixel of each block."""

    name = "lighting_blocks"
    masked_by = _BLOCK_DEPTH

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.rate = model.coarse_code(parts.settings)
        self.reads = (*self.reads, Access(self.masked_by, "depth"))
        format, block = parts.settings.shading.color_format, model.decode(self.rate)
        self.writes = (Access(_BLOCKS, "color", format=format, texel=block),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether light is drawn twice."""
        return by_blocks(settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline of lighting, for blocks of this pass's rate where the mask lets them pass."""
        lighting = super().describe()
        return replace(
            lighting,
            shaders=(lighting.shaders[0], "rates/lighting.frag"),
            defines=(*lighting.defines, ("RATE", f"{self.rate}u")),
            depth="test",
            name=self.name,
        )


class PixelLightingPass(BlockLightingPass):
    """Lights each pixel of the texels whose rate is 1x1, beside those that have the light of their blocks."""

    name = "lighting_pixels"
    masked_by = _PIXEL_DEPTH

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.rate = 0
        self.writes = (Access("color_lit", "color", of=_SPREAD),)
