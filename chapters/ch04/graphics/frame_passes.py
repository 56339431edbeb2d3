"""All passes that a frame of this chapter can have, by name; which of them it has, the graph says."""

from __future__ import annotations

from typing import Any

from common.scene import Scene

from ..passes.forward import ForwardPass
from ..passes.instance_id import InstanceIdPass
from ..passes.resolve import ResolvePass
from ..passes.tonemap import TonemapPass
from ..settings import Settings
from .pipelines import Pipelines
from .scene_data import SceneData


def make_passes(scene: Scene, settings: Settings, data: SceneData, pipelines: Pipelines) -> dict[str, Any]:
    """Return the passes; nothing is on the GPU before `create` is called, and for those left out it never is."""
    forward = ForwardPass(scene, settings, data, pipelines)
    passes = (
        forward,
        InstanceIdPass(forward, data, pipelines),
        ResolvePass(settings, pipelines),
        TonemapPass(settings, pipelines),
    )
    return {made.name: made for made in passes}
