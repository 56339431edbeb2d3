"""Motion vectors outside of their passes: whether any object has moved, and whose previous vertices are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import FrameInfo, Pass, Technique
from common import layouts
from common.scene import Scene

from ..cloth.passes import VERTICES, ClothPass
from ..frames.backend.backend import Backend
from ..frames.frame import SLOTS
from ..graph.types import Touch
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .model import OBJECTS, in_use
from .passes import MotionObjectsPass

_READ = Touch("", frozenset({"vertex"}), frozenset({"storage_read"}))
"""The last use of a slot's vertices: the frame after reads them as those of the frame before."""


class MotionTechnique(Technique):
    """Decides in each frame whether the pass of objects draws.

    Vertices that deform exist once per slot, and slots take turns: the other slot has those of the frame before. Three
    cases are exceptions: a frame without history, a frame for which the pages of geometry were replaced, and a cloth
    that comes into view, since the vertices of invisible cloth are not written. In the first two no object has a motion
    of its own in this frame, in the third that cloth has none.
    """

    name = "motion"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._fresh = True
        self._passes: Any = None
        self._drawn = False
        self._pages: Any = None
        self._key: Any = None
        self._revision, self._moving = -1, 0
        self._flags: list[Any] = [None] * SLOTS

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Find the passes; order writes of vertices after the reads of the frame after, if there are any."""
        self._data, self._scene = parts.data, parts.scene
        objects, cloth = passes[OBJECTS], passes.get(ClothPass.name)
        assert isinstance(objects, MotionObjectsPass), OBJECTS
        self._objects = objects
        self._cloth = cloth if isinstance(cloth, ClothPass) and cloth.externals else None
        if self._scene.deformations and in_use(parts.settings, parts.outputs):
            parts.data.vertices_read_twice = True
            if self._cloth is not None:
                self._cloth.externals = {
                    name: replace(external, enters=_READ) if name == VERTICES else external
                    for name, external in self._cloth.externals.items()
                }

    def prepare(self, frame: FrameInfo) -> int:
        """Find out whether anything has moved since the frame before; return the bytes written."""
        if frame.passes is not self._passes:
            self._passes = frame.passes
            self._drawn = self._objects in frame.passes
            ordered = self._data.vertices_read_twice or not self._scene.deformations
            assert ordered or not self._drawn, "a pass reads motion, and `model.in_use` does not say so"
            self._sways = self._cloth is not None and self._cloth in frame.passes
        if not self._drawn:
            self._fresh, self.work = True, {}
            return 0
        data = self._data
        fresh = self._fresh or data.pages is not self._pages
        if data.records.revision != self._revision:
            self._revision = data.records.revision
            flags = data.records.instances["flags"]
            self._moving = self._visible(flags & layouts.INSTANCE_MOVED)
        moving, written = self._moving, 0
        if self._scene.deformations:
            key = data.records.moving_key(frame.pose)
            sways = self._sways and self._cloth is not None and not self._cloth.resting
            if key != self._key or sways:
                flags = data.records.instances["flags"]
                moving = self._visible(flags & (layouts.INSTANCE_MOVED | layouts.INSTANCE_DEFORMING))
            if self._cloth is not None and not fresh:
                written = self._hide_unknown(frame.slot)
            self._key = key
        self._fresh, self._pages = False, data.pages
        self._objects.active = bool(moving) and not fresh
        self.work = {OBJECTS: 0 if fresh else moving}
        return written

    def _visible(self, flags: np.ndarray) -> int:
        """Return how many visible instances have any of these flags (N,)."""
        return int(np.count_nonzero(flags.astype(bool) & self._scene.instances.visible))

    def _hide_unknown(self, slot: int) -> int:
        """Let cloths whose previous vertices are unknown not deform in this frame; return the bytes written."""
        assert self._cloth is not None, "the scene has cloth"
        chosen, known = self._cloth.known()
        rows, variants = self._data.records.instances[chosen], self._data.variants
        blended = [variants[material].alpha_mode == "blend" for material in rows["material"].tolist()]
        known, flags = known | np.array(blended), rows["flags"]  # culling asks whether those deform
        flags = np.where(known, flags, flags & ~np.uint32(layouts.INSTANCE_DEFORMING))
        held = (self._revision, flags.tobytes())
        if self._flags[slot] == held:
            return 0
        self._flags[slot] = held
        records = self._data.slots[slot].instances.view(layouts.dtype("Instance"))
        records["flags"][chosen] = flags
        return int(flags.nbytes)

    def reset(self, reason: str) -> None:
        """Let the next frame have no frame before."""
        self._fresh = True
