"""The draws of a frame, and their order. Every pass that draws objects asks here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from common import layouts
from common.numerics.transforms import translation
from common.scene import Change, Scene
from common.view.camera import View

from ..frames.commands import DrawGroup, SceneBinding
from ..pipelines.description import PipelineDescription
from . import packing
from .data import SceneData
from .draw_lists import NOTHING, Batch, DrawLists, build_draw_lists


@dataclass
class _Slot:
    """The contents of a slot: the transparent batches, and from where they have their order."""

    transparent: Sequence[Batch] = ()
    seen_from: Any = None
    in_order: bytes = b""


class CulledDraws(Protocol):
    """The draw commands that culling fills on the GPU."""

    def with_meshlets(self, described: PipelineDescription, phase: int) -> PipelineDescription | None:
        """Return a pipeline with task and mesh shaders in place of its vertex shader; None if these are not used."""

    def groups(self, groups: Sequence[DrawGroup], phase: int, tells: bool) -> Sequence[DrawGroup]:
        """Return the groups of all solid batches with the commands of a phase; task shaders count if it `tells`."""

    def transparent(self, slot: int, binding: SceneBinding) -> SceneBinding:
        """Return the bindings of transparent draws, from those without culling."""


class SceneDrawLists:
    """The draw lists of a scene, written to a slot when they differ from what stands there.

    A moving camera changes only the order of transparent draws. Solid objects keep the scene's order:
    sorting them by distance would spare the GPU some shading, and cost the CPU time for every object in every frame.
    """

    slot = 0
    """The slot of this frame."""
    binding: SceneBinding
    """The bindings of the scene for this frame's draws."""

    def __init__(self, scene: Scene, data: SceneData, by_address: bool = True) -> None:
        self._scene, self._data, self._by_address = scene, data, by_address
        self.used: list[int] = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
        """The materials of all objects."""
        self.revision = 0
        """Grows with every change of variants, pages or sets of textures."""
        self._lists = NOTHING
        self._seen: Any = None
        self._key: Any = None
        self._slots: dict[int, _Slot] = {}
        self.visible = 0
        """Instances that are visible."""
        self.culled: CulledDraws | None = None
        """The lists that culling fills; None if all draws of the scene are drawn."""

    def forget(self) -> None:
        """Make all lists anew: variants, pages or textures are other ones."""
        self.revision += 1
        self._seen = self._key = None

    def prepare(self, slot: int, view: View) -> int:
        """Choose what a frame of slot number `slot` draws, and write it; return the bytes written."""
        self.slot, self.binding = slot, self._data.binding(slot)
        data, instances = self._data, self._data.records.instances
        visibility = self._scene.revision[Change.VISIBILITY]
        seen = (visibility, data.records.revision)
        if seen != self._seen:
            self._seen = seen
            mirrored = (instances["flags"] & layouts.INSTANCE_MIRRORED) != 0
            key = (visibility, mirrored.tobytes())
            if key != self._key:
                self._key = key
                self._slots.clear()
                self.visible = int(self._scene.instances.visible.sum())
                self._lists = build_draw_lists(
                    self._scene, data.variants, mirrored, data.page_of, data.first_index, data.textures_of
                )
        lists, written = self._lists, 0
        if slot not in self._slots:
            written += data.write_commands(slot, lists.commands)
            self._slots[slot] = _Slot()
        held = self._slots[slot]
        if not len(lists.transparent):
            return written
        seen_from = (data.records.revision, view.world_from_view.tobytes())
        if seen_from != held.seen_from:
            view_from_origin = view.view_from_world() @ translation(self._scene.origin)
            centers = instances["bounds_centre"][lists.transparent, :3]
            commands, held.transparent = lists.in_order(packing.back_to_front(centers, view_from_origin))
            written += data.write_commands(slot, commands, len(lists.commands) - len(commands))
            held.in_order = commands.tobytes()
            held.seen_from = seen_from
        return written

    @property
    def lists(self) -> DrawLists:
        """The draws of the scene; another object after every change."""
        return self._lists

    def in_phases(self, phases: Sequence[int], groups: list[DrawGroup], tells: bool) -> list[DrawGroup]:
        """Return groups of solid draws with the commands that culling has left in these phases; without any all."""
        if self.culled is None or not phases:
            return groups
        return [group for phase in phases for group in self.culled.groups(groups, phase, tells)]

    @property
    def transparent_binding(self) -> SceneBinding:
        """The bindings of transparent draws: `binding`, with the commands that culling has left."""
        return self.binding if self.culled is None else self.culled.transparent(self.slot, self.binding)

    @property
    def solid(self) -> Sequence[Batch]:
        """The batches of opaque and masked draws."""
        return self._lists.solid

    @property
    def transparent(self) -> Sequence[Batch]:
        """The batches of transparent draws, farthest first, from the slot of this frame."""
        return self._slots[self.slot].transparent

    def key(self, slot: int) -> Any:
        """Return what a recording of the slot's draws is good for, to be compared with what it was made from.

        The GPU reads records by address as they are when it draws; recorded one by one they are what they were.
        """
        held = self._slots[slot]
        batches = (self._lists.solid, held.transparent)
        return batches if self._by_address else (*batches, self._key, held.in_order)
