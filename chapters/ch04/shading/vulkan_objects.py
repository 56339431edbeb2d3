"""What passes have in common that draw the scene's objects with pipelines of their own."""

from __future__ import annotations

from dataclasses import replace

from backends.contract import Access

from ..frames.vulkan_commands import Commands, DrawGroup
from ..pipelines.vulkan import Built, GraphicsPipeline, Pipelines
from ..scene.packing import Variant
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from .vulkan_forward import ForwardPass


class ObjectsPass:
    """Draws the objects of the forward pass's lists: those that are solid, or those that are `transparent`.

    The forward pass itself may be left out of the frame; it still keeps the lists, which all passes share.
    """

    name: str
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]
    transparent = False

    def __init__(
        self, forward: ForwardPass, settings: Settings, data: SceneData, pipelines: Pipelines
    ) -> None:
        self._forward, self._settings = forward, settings
        self._data, self._pipelines = data, pipelines
        self._made: dict[Variant, Built] = {}
        self.built: list[Built] = []

    def part_of(self, variant: Variant) -> Variant:
        """Return what this pass needs of a material's variant: materials that differ in the rest share a pipeline."""
        return variant

    def describe(self, variant: Variant) -> GraphicsPipeline:
        """Return the pipeline that draws materials of `variant`."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipelines of what is drawn, and no other; again when a material became another kind."""
        self._forward.forget()
        found = dict.fromkeys(self._data.variants[material] for material in self._forward.used)
        kinds = [variant for variant in found if (variant.alpha_mode == "blend") == self.transparent]
        self.built = self._pipelines.get([self.describe(variant) for variant in kinds])
        self._made = dict(zip(kinds, self.built, strict=True))

    def _group(self, group: DrawGroup) -> DrawGroup:
        variant = self._data.variants[group.batch.material]
        textures = group.texture_set if self.part_of(variant).roles else None
        return replace(group, pipeline=self._made[variant], texture_set=textures)

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        forward = self._forward
        groups = [self._group(one) for one in (forward.transparent if self.transparent else forward.solid)]
        data, slot = self._data, forward.slot
        commands.draw_groups(groups, data.frame_set(slot), data.slots[slot].commands)
