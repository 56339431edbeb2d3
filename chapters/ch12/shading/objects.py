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

    draws_solid = True
    """Whether the pass draws the solid objects."""

    draws_blended = False
    """Whether the pass draws the transparent objects."""

    tells = False
    """Whether the counters of culling are those of this pass."""

    phases: tuple[int, ...] = (0, 1)
    """The phases of culling whose solid draws the pass records (culling/lists.py)."""

    mesh_pipelines: Sequence[Built] = ()
    """The pipelines with mesh shaders."""

    def __init__(self, parts: PassParts) -> None:
        self._scene, self._settings = parts.scene, parts.settings
        self._data, self._draws, self._pipelines = parts.data, parts.draws, parts.pipelines
        self._built: dict[Variant, Built] = {}
        self._with_meshlets: dict[tuple[Variant, int], Built] = {}
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
        self._create_meshlets(kinds)

    def _create_meshlets(self, kinds: Sequence[Variant]) -> None:
        """Build the pipelines with mesh shaders, one for each phase, if culling uses them."""
        culled = self._draws.culled
        solid = [variant for variant in kinds if variant.alpha_mode != "blend"] if self.draws_solid else []
        keys = [(variant, phase) for variant in solid for phase in self.phases]
        described = [culled.with_meshlets(self.describe(it), phase) for it, phase in keys] if culled else []
        pairs = [(key, it) for key, it in zip(keys, described, strict=False) if it is not None]
        self.mesh_pipelines = built = self._pipelines.get([it for _, it in pairs])
        self._with_meshlets = {key: pipeline for (key, _), pipeline in zip(pairs, built, strict=True)}
        self.pipelines = [*self.pipelines, *built]

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
                with_meshlets=[self._with_meshlets.get((variant, phase)) for phase in (0, 1)],
            )
        return self._groups[key]

    def split(self, late: ObjectsPass) -> str:
        """Draw the early phase alone, and let `late` draw over it; return the name of the early depth."""
        self.phases, late.phases, late.name = (0,), (1,), f"{self.name}_late"
        late.reads = self.reads
        late.writes = tuple(replace(it, of=f"{it.resource}_early", clear=None) for it in self.writes)
        self.writes = tuple(replace(it, resource=f"{it.resource}_early") for it in self.writes)
        return next(access.resource for access in self.writes if access.use == "depth")

    def record_solid(self, commands: Commands) -> None:
        """Record the solid draws of the pass's phases."""
        groups = self._draws.in_phases(self.phases, self.groups(self._draws.solid), self.tells)
        commands.draw_groups(groups, self._draws.binding)

    def record(self, commands: Commands) -> None:
        """Record the draws of this frame."""
        self.record_solid(commands)

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on: the lists of the scene."""
        return self._draws.key(slot)
