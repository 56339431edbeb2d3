"""The draws of a frame, and their order. Every pass that draws objects asks here."""

from __future__ import annotations

from typing import Any

import numpy as np

from common import layouts
from common.numerics.transforms import translation
from common.scene import Change, Scene
from common.view.camera import View

from ..frames.commands import SceneBinding
from . import packing
from .data import SceneData
from .draw_lists import NOTHING, Batch, build_draw_lists


class SceneDrawLists:
    """The draw lists of a scene, built anew only when visibility or the handedness of an object changed."""

    binding: SceneBinding
    """The bindings of the scene for this frame's draws."""

    def __init__(self, scene: Scene, data: SceneData) -> None:
        self._scene, self._data = scene, data
        self.used: list[int] = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
        """The materials of all objects."""
        self._key: Any = None
        self._lists = self._unsorted = NOTHING
        self.order: list[int] = []
        """In which order this frame draws `transparent`: the farthest first."""

    def forget(self) -> None:
        """Build all lists anew: materials became other ones."""
        self._key = None

    def prepare(self, slot: int, view: View) -> None:
        """Choose what a frame of slot number `slot` draws, from the records that were written for it."""
        scene, instances = self._scene, self._data.records.instances
        visibility = scene.revision[Change.VISIBILITY]
        mirrored = (instances["flags"] & layouts.INSTANCE_MIRRORED) != 0
        key = (visibility, mirrored.tobytes())
        if key != self._key:
            self._unsorted = build_draw_lists(scene, self._data.variants, mirrored, self._data.draw)
            self._key = key
        self.binding = self._data.binding(slot)
        view_from_origin = view.view_from_world() @ translation(scene.origin)
        # Sorted from the scene's order every time: what stands at one depth must not depend on the frame before.
        lists = self._unsorted.nearest_first(
            packing.view_depth(instances["bounds_centre"][:, :3], view_from_origin)
        )
        self._lists = lists
        if lists.transparent:
            centers = instances["bounds_centre"][lists.transparent_instances, :3]
            self.order = packing.back_to_front(centers, view_from_origin).tolist()

    @property
    def solid(self) -> list[Batch]:
        """What this frame draws of opaque and masked objects, each batch from the nearest on."""
        return self._lists.solid

    @property
    def transparent(self) -> list[Batch]:
        """The transparent objects, one batch each, in the order of the scene: the same list until they change."""
        return self._lists.transparent
