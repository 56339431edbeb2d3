"""The instance-id pass: which object is nearest at each pixel, drawn only when somebody asks for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access
from common.scene import Scene

from ..graphics.commands import Commands
from ..graphics.pipelines import GraphicsPipeline, Pipelines
from ..graphics.scene_data import SceneData
from ..logic.packing import Variant
from ..settings import Settings
from .forward import ForwardPass


class InstanceIdPass:
    """Draws the solid objects again where their depth equals that of the forward pass: those are the visible ones.

    Transparent objects are left out: at their pixels the id is that of what shines through.
    """

    name = "instance_id"
    reads = (Access("depth", "depth"),)
    writes = (Access("instance_id", "color", format="r32ui", clear=(0, 0, 0, 0)),)

    def __init__(self, forward: ForwardPass, data: SceneData, pipelines: Pipelines) -> None:
        self._forward, self._data, self._pipelines = forward, data, pipelines
        self._made: dict[int, Any] = {}

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is anything to tell apart; whether anybody asks is known from the outputs."""
        return len(scene.instances) > 0

    def _describe(self, variant: Variant) -> GraphicsPipeline:
        return GraphicsPipeline(
            shaders=("forward.vert", "instance_id.frag"),
            set_layouts=self._data.set_layouts(variant),
            defines=variant.defines,
            streams=self._data.vertex_streams(variant),
            color="r32ui",
            depth="equal",
            name="instance id",
        )

    def create(self) -> None:
        """Build one pipeline per variant of a solid material that is drawn."""
        for material in self._forward.used:
            variant = self._data.variants[material]
            if variant.alpha_mode != "blend":
                self._made[material] = self._pipelines.get([self._describe(variant)])[0]

    def record(self, commands: Commands) -> None:
        """Record the forward pass's solid draws with the id's pipelines."""
        groups = [replace(group, pipeline=self._made[group.material]) for group in self._forward.lists.solid]
        commands.bind_geometry(*self._forward.geometry)
        commands.draw_groups(groups, self._forward.frame_set)
