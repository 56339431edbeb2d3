"""What lights by the mask: a rasteriser that reads it as an attachment, or what takes its place. No device.

The mask decides which pixels are lit, so all light the same ones. The rasteriser reads a byte for each texel, and the
device says how many pixels a texel has. Shaders read 32 bits, which every device stores from a shader.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from backends.contract import Access, Plan
from common.settings import replaced

from ..graph.file import graph_path, read_graph
from ..graph.plan import graph_name
from . import model

S = TypeVar("S")

FEATURE = "shading-rate"
"""The feature of the device, as the plan has it."""

DRAWN, COMPUTED, SPREAD = "lighting", "lighting_compute", "rate_spread"
"""The passes that light by the rasteriser and by compute, and one of those that light in two passes (blocks.py)."""


@dataclass(frozen=True)
class Mask:
    """The image of the mask: its format, pixels along a texel, and the use of the pass that lights by it."""

    format: str
    texel: int
    drawn: bool

    @property
    def texels(self) -> tuple[int, int]:
        """The pixels of a texel, across and down."""
        return self.texel, self.texel


def texel_of(limits: Mapping[str, int], wanted: int = 0) -> int:
    """Return the pixels along a square texel of the device's attachment, as near to TEXEL as can be; 0 if none can.

    If a size is `wanted`, it is that or none. `limits` are those of `backends.vulkan.instance.shading_rates`; both ends
    are powers of 2. Texels are no larger than the tiles of the kernels.
    """
    least, most = limits.get("minShadingRateTexel", 0), limits.get("maxShadingRateTexel", 0)
    texel = min(max(wanted or model.TEXEL, least), most)
    fits = (
        (not wanted or texel == wanted)
        and model.LONGEST <= least <= most
        and texel <= model.EDGE_TILE
        and texel * texel <= limits.get("maxComputeWorkGroupInvocations", 0)
    )
    return texel if fits else 0


def mask_of(settings: Any, limits: Mapping[str, int]) -> Mask:
    """Return the mask of frames, if they have one; `settings` are `settled`."""
    by_device = model.wanted(settings) and settings.rates.rate_fragments == "device"
    drawn = by_device and COMPUTED not in _passes(settings)
    if not drawn:
        return Mask("r32ui", model.texel_of(settings), drawn)
    return Mask("r8ui", texel_of(limits, settings.rates.rate_texel), drawn)


def attached(settings: Any, limits: Mapping[str, int]) -> tuple[Access, ...]:
    """Return the read of the mask by the rasteriser; nothing if frames have no mask, or compute reads it."""
    if not (model.wanted(settings) and model.MASK in _passes(settings)):
        return ()
    mask = mask_of(settings, limits)
    return (Access(model.RATES, "rate", format=mask.format, texel=mask.texels),) * mask.drawn


def settled(settings: S, plan: Plan, limits: Mapping[str, int]) -> S:
    """Return the settings of a device: what "auto" of graph and rate_fragments is, and no policy without an effect."""
    if _without(settings, plan, limits):
        return replaced(settings, rate_policy="none")
    if not model.wanted(settings):
        return settings
    graph, fragments = settings.graph.name, settings.rates.rate_fragments  # type: ignore[attr-defined]
    drawn = fragments != "passes" and not _why_not(settings, plan, limits)
    if graph == "auto":
        graph = "deferred" if drawn else "compute"
    return replaced(settings, graph=graph, rate_fragments="device" if drawn else "passes")


def without_effect(settings: Any, plan: Plan, limits: Mapping[str, int]) -> str:
    """Return the sentence about a policy that has no effect, with the reason; "" if it has one, or there is none."""
    why = _without(settings, plan, limits)
    if why:
        return f"rate_policy={settings.rates.rate_policy} has no effect with {why}."
    if not model.wanted(settings) or settings.rates.rate_fragments != "device":
        return ""
    if settings.graph.name != "auto":
        return (
            "rate_fragments=device has no effect with graph=compute." if COMPUTED in _passes(settings) else ""
        )
    why = _why_not(settings, plan, limits)
    return f"rate_fragments=device has no effect, since {why}: graph=compute lights blocks." if why else ""


def _without(settings: Any, plan: Plan, limits: Mapping[str, int]) -> str:
    shading, overlay = settings.shading, settings.culling.overlay
    if settings.rates.rate_policy == "none":
        return ""
    if shading.msaa > 1:
        return f"msaa={shading.msaa}, since a G-buffer holds one sample a pixel"
    if not model.wanted(settings):
        return f"view={shading.view}, which shows a quantity of surfaces while they are drawn"
    if overlay != "off":
        return f"culling_overlay={overlay}, which is drawn over the forward pass"
    if settings.graph.name == "auto":
        return ""
    passes, chosen = _passes(settings), f"graph={settings.graph.name}"
    if model.MASK not in passes or not {DRAWN, COMPUTED} & passes:
        return f"{chosen}, which has no passes '{model.MASK}' and '{COMPUTED}', and graph=compute has both"
    twice = SPREAD in passes and settings.rates.rate_fragments != "device"
    why = "" if COMPUTED in passes or twice else _why_not(settings, plan, limits)
    if why and SPREAD in passes:
        return f"rate_fragments=device, since {why}, and rate_fragments=passes needs none"
    return f"{chosen}, since {why}, and there is no pass '{SPREAD}'" if why else ""


def _why_not(settings: Any, plan: Plan, limits: Mapping[str, int]) -> str:
    """Return why the rasteriser cannot light by the mask; "" if it can."""
    if not plan.native(FEATURE):
        reasons = [choice.reason for choice in plan.choices if choice.feature == FEATURE]
        return f"there is no variable rate shading ({reasons[0] if reasons else 'the plan has none'})"
    if not texel_of(limits, settings.rates.rate_texel):
        return "the device has no texels of the size of rate_texel, or none that a work group can have"
    if not limits.get("shadingRates", 0) >> model.coarse_code(settings) & 1:
        return f"the device draws no fragments of {settings.rates.rate_coarse} pixels"
    return ""


def _passes(settings: Any) -> set[str]:
    return {*read_graph(graph_path(graph_name(settings))).passes.values()}
