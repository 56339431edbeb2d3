"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

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
from ..passes.lighting_compute import ComputeLightingPass
from ..passes.resolve import ResolvePass
from ..passes.tonemap import TonemapPass
from ..passes.transparent import TransparentPass
from ..settings import Settings
from .pipelines import Pipelines
from .scene_data import SceneData


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
        ResolvePass(settings, pipelines),
        TonemapPass(settings, pipelines),
    )
    return {made.name: made for made in passes}
