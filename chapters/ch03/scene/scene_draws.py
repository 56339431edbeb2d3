"""What each frame draws of the scene, and which records have to be written for it: on either backend the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from common import layouts
from common.numerics.transforms import translation
from common.scene import Change, Scene
from common.view.camera import View

from . import packing
from .draw_lists import NOTHING, Batch, build_draw_lists
from .packing import Variant
from .records import Records


class Data(Protocol):
    """What is asked of the scene's data on the GPU."""

    variants: list[Variant]
    page_of: np.ndarray
    first_index: np.ndarray
    records: Records

    @property
    def textures_of(self) -> np.ndarray:
        """(M,) number of the set that holds each material's textures."""

    def write_commands(self, slot: int, commands: np.ndarray, first: int = 0) -> int:
        """Write records of draws into the slot's list, from number `first` on; return the bytes written."""


@dataclass
class _Slot:
    """What was written to a slot: the transparent batches, and from where they have their order."""

    transparent: Sequence[Batch] = ()
    seen_from: Any = None


class SceneDraws:
    """The draw lists of a scene, written to a slot when they differ from what stands there.

    A camera that moves changes nothing but the order of what is transparent. Solid objects keep the scene's order:
    sorting them by distance would spare the GPU some shading, and cost the CPU time for every object in every frame.
    """

    def __init__(self, scene: Scene, data: Data) -> None:
        self._scene, self._data = scene, data
        self._lists = NOTHING
        self._seen: Any = None
        self._key: Any = None
        self._slots: dict[int, _Slot] = {}
        self.visible = 0
        """Instances that are visible."""

    def forget(self) -> None:
        """Make all lists anew: variants, pages or textures are other ones."""
        self._seen = self._key = None

    def prepare(self, slot: int, view: View) -> int:
        """Choose what a frame of slot number `slot` draws, and write it; return the bytes written."""
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
            held.seen_from = seen_from
        return written

    @property
    def solid(self) -> Sequence[Batch]:
        """The batches of what is opaque or masked."""
        return self._lists.solid

    def transparent(self, slot: int) -> Sequence[Batch]:
        """The batches of what is transparent, farthest first, as they stand in the slot."""
        return self._slots[slot].transparent
