"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

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
from .lighting_compute import ComputeLightingPass
from .pipelines import Pipelines
from .resolve import ResolvePass
from .scene_data import SceneData
from .tonemap import TonemapPass
from .transparent import TransparentPass


def make_passes(scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines) -> dict[str, Any]:
    """Return the passes; nothing is on the GPU before `create` is called, and for those left out it never is.

    The forward pass chooses what is drawn, for all the others: a renderer prepares it in each frame, whether or not it
    is a step of the graph.
    """
    forward = ForwardPass(scene, settings, data, pipelines)
    drawn = (DepthPrepass, GBufferPass, LightingPass, ComputeLightingPass, TransparentPass)
    lens = (CircleOfConfusionPass, BokehPass, DepthOfFieldPass)
    passes = (
        forward,
        *(kind(forward, settings, data, pipelines) for kind in (*drawn, *lens)),
        InstanceIdPass(forward, data, pipelines),
        ResolvePass(settings, data, pipelines),
        TonemapPass(settings, data, pipelines),
    )
    return {made.name: made for made in passes}
