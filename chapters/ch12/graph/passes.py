"""All passes of this chapter by name; the graph selects the passes of a frame."""

from __future__ import annotations

from backends.contract import Pass

from ..motion.passes import MotionObjectsPass, MotionPass
from ..post.bokeh import BokehPass
from ..post.circle_of_confusion import CircleOfConfusionPass
from ..post.depth_of_field import DepthOfFieldPass
from ..post.finish_passes import FxaaPass, MotionBlurPass, SharpenPass
from ..post.resolve import ResolvePass
from ..post.tonemap import TonemapPass
from ..rates.blocks import BlockLightingPass, PixelLightingPass, RateDepthPass, RateSpreadPass
from ..rates.passes import RateEdgesPass, RateMaskPass
from ..scene.pass_parts import PassParts
from ..shading.depth_prepass import DepthPrepass
from ..shading.forward import ForwardPass
from ..shading.gbuffer import GBufferPass
from ..shading.instance_id import CentreDepthPass, InstanceIdPass
from ..shading.lighting import LightingPass
from ..shading.lighting_compute import ComputeLightingPass
from ..shading.transparent import TransparentPass
from ..ssao.passes import SsaoBlurPass, SsaoPass
from ..visibility.passes import VisibilityPass
from ..visibility.resolve import ResolveSurfacesPass


def make_passes(parts: PassParts) -> dict[str, Pass]:
    """Return all passes by name; they use no GPU memory before `create`, which runs only for passes of the frame."""
    passes: tuple[Pass, ...] = (
        ForwardPass(parts),
        DepthPrepass(parts),
        GBufferPass(parts),
        VisibilityPass(parts),
        ResolveSurfacesPass(parts),
        SsaoPass(parts),
        SsaoBlurPass(parts, (1, 0)),
        SsaoBlurPass(parts, (0, 1)),
        RateMaskPass(parts),
        RateDepthPass(parts),
        BlockLightingPass(parts),
        RateSpreadPass(parts),
        PixelLightingPass(parts),
        LightingPass(parts),
        ComputeLightingPass(parts),
        TransparentPass(parts),
        CircleOfConfusionPass(parts),
        BokehPass(parts),
        DepthOfFieldPass(parts),
        InstanceIdPass(parts),
        CentreDepthPass(parts),
        MotionPass(parts),
        MotionObjectsPass(parts),
        ResolvePass(parts),
        RateEdgesPass(parts),
        MotionBlurPass(parts),
        SharpenPass(parts),
        TonemapPass(parts),
        FxaaPass(parts),
    )
    return {gpu_pass.name: gpu_pass for gpu_pass in passes}
