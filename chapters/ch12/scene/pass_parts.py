"""What passes are made from: the scene, its data on the GPU, and what builds pipelines."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from common.scene import Scene

from ..pipelines.description import Pipelines
from ..settings import Settings
from .data import SceneData
from .scene_draws import SceneDrawLists


@dataclass(frozen=True)
class PassParts:
    """The parts of a renderer that its passes share; each is that of the renderer's backend."""

    scene: Scene
    settings: Settings
    data: SceneData
    draws: SceneDrawLists
    pipelines: Pipelines
    limits: Mapping[str, int] = field(default_factory=dict)
    """The limits of the device, as in its capabilities."""
    outputs: Collection[str] = ()
    """The outputs that can be read."""
