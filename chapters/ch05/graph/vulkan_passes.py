"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

from typing import Any

from common.scene import Scene

from ..pipelines.vulkan import Pipelines
from ..post.vulkan_bokeh import BokehPass
from ..post.vulkan_circle_of_confusion import CircleOfConfusionPass
from ..post.vulkan_depth_of_field import DepthOfFieldPass
from ..post.vulkan_resolve import ResolvePass
from ..post.vulkan_tonemap import TonemapPass
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from ..shading.vulkan_depth_prepass import DepthPrepass
from ..shading.vulkan_forward import ForwardPass
from ..shading.vulkan_gbuffer import GBufferPass
from ..shading.vulkan_instance_id import InstanceIdPass
from ..shading.vulkan_lighting import LightingPass
from ..shading.vulkan_lighting_compute import ComputeLightingPass
from ..shading.vulkan_transparent import TransparentPass


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
