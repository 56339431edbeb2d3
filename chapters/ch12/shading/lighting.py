"""The lighting pass: every pixel's surface out of the G-buffer, lit by all lights."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..rates import passes as rates
from ..rates.native import attached
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..ssao import model as ssao
from .deferred import EMISSION, TARGETS, emission_defines, emits, light_defines, sampled
from .sky import Sky


class LightingPass(FullscreenPass):
    """Lights each pixel once; where nothing was drawn it shows the sky, or the background's grey."""

    name = "lighting"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._has_sky = Sky.needed(parts.scene, parts.settings)
        self._occlusion = ssao.light_defines(parts.scene, parts.settings)
        occlusion = (ssao.RESULT,) if self._occlusion else ()
        others = tuple(Access(name, "sampled") for name in ("depth", *occlusion))
        self.reads = (*sampled(parts.settings), *others)
        self.writes = (Access("color_lit", "color", format=parts.settings.shading.color_format),)
        self._scene = parts.scene
        self._attached = attached(parts.settings, parts.limits) if self.name == "lighting" else ()
        self.reads = (*self.reads, *self._attached)

    def declare(self) -> None:
        """Read the emission, behind the depth, only while a material emits."""
        kept = [access for access in self.reads if access.resource != EMISSION]
        behind = len(TARGETS) + 1
        emission = [Access(EMISSION, "sampled")] * emits(self._scene, self._settings)
        self.reads = (*kept[:behind], *emission, *kept[behind:])

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Even an empty scene has a background; with shading rates it is lit by blocks (rates/blocks.py)."""
        return not rates.by_blocks(settings)

    def describe(self) -> PipelineDescription:
        """Return the pipeline, with the lights and the environment that any of the materials takes part in."""
        variants = [self._data.variants[material] for material in self._draws.used]
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "shading/lighting.frag"),
            defines=(
                *(*light_defines(variants, self._has_sky, self._settings), *self._occlusion),
                *emission_defines(self._scene, self._settings),
                *(("BY_RATES", 1),) * len(self._attached),
            ),
            color=self._settings.shading.color_format,
            depth=None,
            name="lighting",
            by_rates=bool(self._attached),
        )
