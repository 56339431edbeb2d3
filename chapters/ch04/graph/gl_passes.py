"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

from typing import Any

from common.scene import Scene

from ..pipelines.gl import Pipelines
from ..post.gl_bokeh import BokehPass
from ..post.gl_circle_of_confusion import CircleOfConfusionPass
from ..post.gl_depth_of_field import DepthOfFieldPass
from ..post.gl_resolve import ResolvePass
from ..post.gl_tonemap import TonemapPass
from ..scene.gl_data import SceneData
from ..settings import Settings
from ..shading.gl_depth_prepass import DepthPrepass
from ..shading.gl_forward import ForwardPass
from ..shading.gl_gbuffer import GBufferPass
from ..shading.gl_instance_id import InstanceIdPass
from ..shading.gl_lighting import LightingPass
from ..shading.gl_transparent import TransparentPass


def make_passes(scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines) -> dict[str, Any]:
    """Return the passes; nothing is on the GPU before `create` is called, and for those left out it never is.

    The forward pass chooses what is drawn, for all the others: a renderer prepares it in each frame, whether or not it
    is a step of the graph.
    """
    forward = ForwardPass(scene, settings, data, pipelines)
    drawn = (DepthPrepass, GBufferPass, LightingPass, TransparentPass)
    lens = (CircleOfConfusionPass, BokehPass, DepthOfFieldPass)
    passes = (
        forward,
        *(kind(forward, settings, data, pipelines) for kind in (*drawn, *lens)),
        InstanceIdPass(forward, data, pipelines),
        ResolvePass(settings, data, pipelines),
        TonemapPass(settings, data, pipelines),
    )
    return {made.name: made for made in passes}
