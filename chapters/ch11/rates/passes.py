"""The passes of the mask of shading rates.

history_rates of the last frame, G-buffer -> rate_mask -> rates -> lighting_compute, or lighting (rates/native.py)
the finished picture                      -> rate_edges -> history_rates, for the next frame
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from backends.contract import Access, Pass, Sources
from common.scene import Scene

from ..frames.commands import Commands
from ..graph.file import graph_path, read_graph
from ..graph.plan import graph_name
from ..pipelines.compute_description import ComputeDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.deferred import code_defines, sampled
from ..shading.views import tonemap_defines
from . import model
from .native import mask_of


def in_use(settings: Settings) -> bool:
    """Whether frames have a mask: the settings want one, and their graph has the pass."""
    return (
        model.wanted(settings) and model.MASK in read_graph(graph_path(graph_name(settings))).passes.values()
    )


def by_blocks(settings: Settings) -> bool:
    """Whether fragments are lit in two passes, since the device has no shading rates of its own."""
    if not in_use(settings) or settings.rates.rate_fragments == "device":
        return False
    return "rate_spread" in read_graph(graph_path(graph_name(settings))).passes.values()


def read(settings: Settings) -> tuple[Access, ...]:
    """Return the read of the mask, for a pass that lights by it."""
    return (Access(model.RATES, "sampled", format="r32ui"),) * in_use(settings)


def follows_edges(settings: Settings) -> bool:
    """Whether frames have a mask that follows edges."""
    return settings.rates.rate_policy == "sobel" and in_use(settings)


class RatePass(Pass):
    """The common base: a kernel with a work group for each tile of the picture, which has whole texels of the mask."""

    still = 0
    """Frames without a change, up to KEPT; from the technique."""

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines, self._draws = parts.settings, parts.pipelines, parts.draws
        self._mask = mask_of(parts.settings, parts.limits)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether frames have a mask."""
        return in_use(settings)

    def build(self, described: ComputeDescription, stills: Sequence[int], tile: int) -> None:
        """Build the pipelines of the values that STILL has after 0, 1, ... frames without a change.

        They have one module, and so the same bindings. A work group has a tile of so many pixels.
        """
        values = sorted(set(stills))
        built = self._pipelines.get(
            [replace(described, specialization=(("STILL", value),) * (value > 0)) for value in values]
        )
        self._by_still = [built[values.index(still)] for still in stills]
        self.pipelines, self._tile = built[:1], tile

    def key(self, slot: int) -> Any:
        """Return what the recording depends on: few counts have a pipeline of their own."""
        return self._draws.key(slot), id(self._by_still[self.still])

    def record(self, commands: Commands) -> None:
        """Record a work group for each tile."""
        scene = self._draws.binding if self.sources == BEHIND_SCENE else None
        commands.bind_compute(self._by_still[self.still], scene)
        commands.dispatch(*self.tiles(commands.extent, self._tile))

    def tiles(self, texels: Sequence[int], pixels: int) -> tuple[int, ...]:
        """Return the tiles of so many pixels that cover a mask of so many texels; a tile has one at least."""
        across = max(1, pixels // self._mask.texel)
        return tuple(-(-side // across) for side in texels)


class RateMaskPass(RatePass):
    """Chooses the rate of each texel, before anything is lit."""

    name = model.MASK
    sources = BEHIND_SCENE

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        if parts.settings.rates.rate_policy == "sobel":
            before = Access(model.EDGES, "sampled", format="r32ui", previous=True)
            self.reads = (*sampled(parts.settings), Access("depth", "sampled"), before)
        self.writes = (Access(model.RATES, "storage", format=self._mask.format, texel=self._mask.texels),)

    def create(self) -> None:
        """Build the pipelines: one for each part of the way to rest."""
        defines = (*model.mask_defines(self._settings, self._mask.texel), *code_defines(self._settings))
        defines = (*defines, ("RATE_FORMAT", self._mask.format))
        built = ComputeDescription("rates/mask.comp", defines, name=self.name)
        rest = (model.WHOLE, model.LAST, model.KEPT) if follows_edges(self._settings) else ()
        self.build(built, (*(0,) * model.WHOLE, *rest), model.GROUP)


class RateEdgesPass(RatePass):
    """Finds the texels in which the luminance of the finished picture changes."""

    name = "rate_edges"
    sources = Sources()

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = Access("color_hdr", "sampled"), Access(model.RATES, "sampled", format=self._mask.format)
        self.writes = (Access(model.EDGES, "storage", format="r32ui", texel=self._mask.texels),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the mask follows edges."""
        return follows_edges(settings)

    def create(self) -> None:
        """Build the pipelines: for edges, and to keep the mask."""
        defines = (*model.mask_defines(self._settings, self._mask.texel), *tonemap_defines(self._settings))
        built = ComputeDescription("rates/edges.comp", defines, name=self.name)
        self.build(built, (*(0,) * model.LAST, model.LAST, model.LAST), model.EDGE_TILE)
