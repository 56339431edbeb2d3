"""The instance-id pass: which object is nearest at each pixel, drawn only when somebody asks for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from backends.contract import Access
from common.scene import Scene

from ..frames.gl_commands import Commands, DrawGroup
from ..pipelines.gl import Built, GraphicsPipeline, Pipelines
from ..scene.gl_data import SceneData
from ..scene.packing import Variant, shape_alone
from ..settings import Settings
from .gl_forward import ForwardPass


class InstanceIdPass:
    """Draws the solid objects again where their depth equals that of the forward pass: those are the visible ones.

    Transparent objects are left out: at their pixels the id is that of what shines through. Where the forward pass has
    several samples a pixel, none of them in its centre, or no depth since it counts, this pass finds out by a depth of
    its own which object is the nearest there. So ids and depth are the same to the bit, whatever the picture is.
    """

    name = "instance_id"

    def __init__(self, forward: ForwardPass, data: SceneData, pipelines: Pipelines) -> None:
        self._forward, self._data, self._pipelines = forward, data, pipelines
        self._made: dict[Variant, Built] = {}
        own_depth = forward.writes[1].resource != "depth"
        ids = Access("instance_id", "color", format="r32ui", clear=(0, 0, 0, 0))
        depth = Access("depth", "depth", format="d32f", clear=(0.0,))
        self.reads = () if own_depth else (Access("depth", "depth"),)
        self.writes = (ids, depth) if own_depth else (ids,)
        self._depth: Literal["write", "equal"] = "write" if own_depth else "equal"

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is anything to tell apart; whether anybody asks is known from the outputs."""
        return len(scene.instances) > 0

    def _describe(self, variant: Variant) -> GraphicsPipeline:
        needed = shape_alone(variant)
        return GraphicsPipeline(
            shaders=("shading/forward.vert", "shading/instance_id.frag"),
            defines=(*needed.defines, *self._data.texture_defines(needed, shape_alone)),
            depth=self._depth,
            name="instance id",
        )

    def create(self) -> None:
        """Build the pipelines of solid materials that are drawn: one for all that are opaque."""
        kinds = dict.fromkeys(self._data.variants[material] for material in self._forward.used)
        solid = [variant for variant in kinds if variant.alpha_mode != "blend"]
        self._made = dict(
            zip(solid, self._pipelines.get([self._describe(one) for one in solid]), strict=True)
        )

    def _group(self, group: DrawGroup) -> DrawGroup:
        variant = self._data.variants[group.batch.material]
        textures = group.textures if shape_alone(variant).roles else ()
        return replace(group, pipeline=self._made[variant], textures=textures)

    def record(self, commands: Commands) -> None:
        """Make the forward pass's solid draws with the id's pipelines."""
        groups = [self._group(group) for group in self._forward.solid]
        commands.draw_groups(groups, self._data.slots[self._forward.slot].commands)
