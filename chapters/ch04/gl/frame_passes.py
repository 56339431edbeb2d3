"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from common.scene import Scene

from ..settings import Settings
from .bokeh import BokehPass
from .circle_of_confusion import CircleOfConfusionPass
from .depth_of_field import DepthOfFieldPass
from .depth_prepass import DepthPrepass
from .forward import ForwardPass
from .gbuffer import GBufferPass
from .instance_id import InstanceIdPass
from .lighting import LightingPass
from .pipelines import Pipelines
from .resolve import ResolvePass
from .scene_data import SceneData
from .tonemap import TonemapPass
from .transparent import TransparentPass


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
        ResolvePass(settings, data, pipelines),
        CircleOfConfusionPass(first, settings, data, pipelines),
        BokehPass(first, settings, data, pipelines),
        DepthOfFieldPass(first, settings, data, pipelines),
        TonemapPass(settings, data, pipelines),
    )
    return {made.name: made for made in passes}
