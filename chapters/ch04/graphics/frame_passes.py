"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from common.scene import Scene

from ..passes.bokeh import BokehPass
from ..passes.circle_of_confusion import CircleOfConfusionPass
from ..passes.depth_of_field import DepthOfFieldPass
from ..passes.depth_prepass import DepthPrepass
from ..passes.forward import ForwardPass
from ..passes.gbuffer import GBufferPass
from ..passes.instance_id import InstanceIdPass
from ..passes.lighting import LightingPass
from ..passes.resolve import ResolvePass
from ..passes.tonemap import TonemapPass
from ..passes.transparent import TransparentPass
from ..settings import Settings
from .pipelines import Pipelines
from .scene_data import SceneData


def make_passes(
    scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines, wanted: Collection[str]
) -> dict[str, Any]:
    """Return the passes; nothing is on the GPU before `create` is called, and for those left out it never is.

    The first one is that which chooses what is drawn: the G-buffer's if it is `wanted`, else the forward path's.
    """
    gbuffer = GBufferPass(scene, settings, data, pipelines)
    forward = ForwardPass(scene, settings, data, pipelines)
    first: ForwardPass = gbuffer if gbuffer.name in wanted else forward
    passes = (
        first,
        gbuffer,
        forward,
        DepthPrepass(first, settings, data, pipelines),
        LightingPass(gbuffer, settings, data, pipelines),
        TransparentPass(gbuffer, settings, data, pipelines),
        InstanceIdPass(first, data, pipelines),
        ResolvePass(settings, pipelines),
        CircleOfConfusionPass(first, settings, data, pipelines),
        BokehPass(first, settings, data, pipelines),
        DepthOfFieldPass(first, settings, data, pipelines),
        TonemapPass(settings, pipelines),
    )
    return {made.name: made for made in passes}
