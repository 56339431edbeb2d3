"""What passes have in common that draw the scene's objects: pipelines by material, and groups of draws with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from backends.contract import Pass

from ..frames.commands import Commands, DrawGroup
from ..pipelines.description import Built, PipelineDescription
from ..scene.draw_lists import Batch
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts


class ObjectsPass(Pass):
    """Draws the objects of the scene's lists with pipelines of its own: the solid ones, unless `takes` says more."""

    shape_only = False
    """Whether the pass asks only where surfaces are, and not how they look."""

    def __init__(self, parts: PassParts) -> None:
        self._scene, self._settings = parts.scene, parts.settings
        self._data, self._draws, self._pipelines = parts.data, parts.draws, parts.pipelines
        self._built: dict[Variant, Built] = {}
        self._groups: dict[tuple[int, int, bool, int, int], DrawGroup] = {}
        self._seen = -1

    def takes(self, variant: Variant) -> bool:
        """Whether materials of `variant` are drawn here."""
        return variant.alpha_mode != "blend"

    def part_of(self, variant: Variant) -> Variant:
        """Return what this pass needs of a material's variant: materials that differ in the rest share a pipeline."""
        return shape_alone(variant) if self.shape_only else variant

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline that draws materials of `variant`."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipelines of all materials that are drawn, and no other; again when one became another kind."""
        self._draws.forget()
        variants = dict.fromkeys(self._data.variants[material] for material in self._draws.used)
        kinds = [variant for variant in variants if self.takes(variant)]
        self.pipelines = self._pipelines.get([self.describe(variant) for variant in kinds])
        self._built = dict(zip(kinds, self.pipelines, strict=True))

    def groups(self, batches: Sequence[Batch]) -> list[DrawGroup]:
        """Return batches of the scene's lists with this pass's pipelines, and with all that they bind."""
        if self._seen != self._draws.revision:
            self._seen = self._draws.revision
            self._groups.clear()
        return [replace(self._group(batch), batch=batch) for batch in batches]

    def _group(self, batch: Batch) -> DrawGroup:
        """Return the group of a batch: the same for all batches of its state."""
        slot = self._draws.slot
        key = (slot, batch.material, batch.mirrored, batch.page, batch.textures)
        if key not in self._groups:
            data, variant = self._data, self._data.variants[batch.material]
            self._groups[key] = DrawGroup(
                batch=batch,
                pipeline=self._built[variant],
                cull=not variant.double_sided,
                front="clockwise" if batch.mirrored else "counter_clockwise",
                page=data.bound_page(slot, batch.page),
                textures=data.texture_set(batch.textures) if self.part_of(variant).roles else None,
            )
        return self._groups[key]

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        commands.draw_groups(self.groups(self._draws.solid), self._draws.binding)

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on: the lists of the scene."""
        return self._draws.key(slot)
