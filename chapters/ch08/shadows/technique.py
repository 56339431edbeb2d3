"""Shadows outside of their pass: which lights cast them, which faces a frame draws, and the buffer of its slot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.contract import Access, FrameInfo, Pass, Technique
from common.scene import Scene

from ..cloth.passes import VERTICES
from ..frames.backend.backend import Backend
from ..page_table.pool import TilePool
from ..page_table.refusal import with_less
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .casters import Casters
from .faces import DRAWN, FACE, UNUSED
from .layout import BlockLayout, pages_size
from .lights import ShadowLights
from .lists import MOST_LAYERS, NO_ROUNDS, Schedule, schedule
from .memory import ShadowMemory
from .passes import LIT, ShadowsPass, read_pages


class Versions:
    """Numbers the contents of arrays, of which each slot has one. Equal contents have one number."""

    def __init__(self) -> None:
        self._of_slot: dict[int, tuple[np.ndarray, np.ndarray, int]] = {}
        self._last = 0

    def number(self, slot: int, array: np.ndarray, field: str = "") -> int:
        """Return the number of the contents of a slot's `array`, or of a field of it; another object is compared."""
        if slot in self._of_slot and self._of_slot[slot][0] is array:
            return self._of_slot[slot][2]
        content = array[field] if field else array
        same = [number for _, known, number in self._of_slot.values() if np.array_equal(known, content)]
        if not same:
            self._last += 1
            same = [self._last]
        self._of_slot[slot] = array, content, same[0]
        return same[0]


class ShadowTechnique(Technique):
    """Owns the memory of shadows.

    A face is drawn when its record differs from the one that it was drawn with, or when any caster has changed. While
    nothing changes, the pass has no rounds, and its recording no commands.
    """

    name = "shadows"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self.memory: ShadowMemory | None = None
        """Pages, targets and buffers, from `create` on, if any light casts shadows."""
        self._drawn = np.zeros(0, FACE)
        self._block = np.zeros(0, np.uint8)
        self._revision = 0
        self._written: dict[int, tuple[int, int]] = {}
        self._slot, self._had_due = -1, False
        self._lights, self._instances = Versions(), Versions()

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and let the passes that light surfaces read its pages."""
        self._parts, self._backend = parts, backend
        self._pass = own = ShadowsPass(parts)
        self.passes = {own.name: own}
        scene, settings = parts.scene, parts.settings
        if not model.possible(scene, settings):
            return
        read_pages([gpu_pass for name, gpu_pass in passes.items() if name in LIT])
        cloth = passes["cloth"]
        if cloth.externals:  # its vertices are drawn, too
            own.reads = (*own.reads, Access(VERTICES, "storage", stages=("vertex",)))
        self._casters = Casters(parts, backend, own, cloth)
        lights = model.records_of(scene, settings)
        words, tiles = model.table_words(scene, settings), model.pool_tiles(scene, settings)

        def make(tiles: int) -> ShadowMemory:
            size = pages_size(tiles)
            self.lights = ShadowLights(parts, TilePool(tiles, size[0], words))
            layout = BlockLayout(lights, len(self.lights.faces), words)
            memory: ShadowMemory = backend.part(__package__).ShadowMemory(backend, layout, size)
            return memory

        self.memory = own.memory = with_less(make, tiles, scene.warnings)
        parts.data.shadows = self.memory
        if own.culls:
            own.counts = backend.part(f"{__package__}.counts").ShadowCounts(backend)
        self._block = np.zeros(self.memory.layout.size, np.uint8)

    @property
    def faces(self) -> np.ndarray:
        """The records of all faces in the last frame, and of places for others."""
        return self.lights.faces

    @property
    def table(self) -> NDArray[np.uint32]:
        """Where the tiles of faces lie in the pages (layout.py)."""
        return self.lights.pool.table

    # --- every frame ---

    def prepare(self, frame: FrameInfo) -> int:
        """Find the faces that are due, and write the buffer of the slot; return the bytes written."""
        memory, own = self.memory, self._pass
        if memory is None or own not in frame.passes:
            return 0
        if frame.slot == self._slot:  # the last frame was never submitted
            self._drawn = np.zeros(0, FACE)
        self._slot = frame.slot
        written = self._parts.data.slots[frame.slot].written
        instances = self._instances.number(frame.slot, written["instance_records"], "world_from_object")
        lights = self._lights.number(frame.slot, written["light_records"])
        changed = self.lights.follow(frame, lights, instances)
        moved = self._casters.follow(frame, memory, instances)
        own.schedule = NO_ROUNDS
        if changed or moved or not len(self._drawn):
            own.schedule = self._due(moved)
            for size in {turn.size for turn in own.schedule.rounds}:
                memory.prepare(size)
        if own.counts is not None:
            own.counts.follow(frame.slot, own.schedule, own.lists)
        due = len(own.schedule.drawn)
        if changed or due or self._had_due:
            self._revision += 1
            self._pack(memory.layout, own.schedule)
            self.work = {
                **self.lights.work,
                "shadow_faces_drawn": due,
                "shadow_bytes": memory.tiles[0] * memory.tiles[1] * model.TILE_BYTES,
            }
        self._had_due = due > 0
        return self._write(memory, frame.slot)

    def _due(self, all_of_them: bool) -> Schedule:
        """Return the rounds of the faces to draw in this frame: the largest first."""
        faces = self.faces
        due = faces["light"] != UNUSED
        if not all_of_them and len(self._drawn):
            rows = [each.view(np.uint8).reshape(len(faces), -1) for each in (faces, self._drawn)]
            due &= (rows[0] != rows[1]).any(axis=1)
        self._drawn = faces.copy()
        numbers = np.flatnonzero(due)
        ordered = numbers[np.argsort(-faces["size"][numbers].astype(np.int64), kind="stable")]
        lists = self._pass.lists
        return schedule(faces, ordered, MOST_LAYERS if lists is None else lists.layers)

    def _pack(self, layout: BlockLayout, due: Schedule) -> None:
        """Make the contents of the buffer, but for the table."""
        block, faces = self._block, self.faces
        block[: layout.drawn].view(np.uint32)[: len(self.lights.words)] = self.lights.words
        block[layout.drawn : layout.lists].view(np.uint32)[: len(due.drawn)] = due.drawn
        block[layout.lists : layout.records].view(np.uint32)[: len(due.lists)] = due.lists
        records = block[layout.records : layout.records + faces.nbytes].view(FACE)
        records[:] = faces
        records["light"][due.drawn & 0xFFF] |= DRAWN

    def _write(self, memory: ShadowMemory, slot: int) -> int:
        """Write to the buffer of a slot what it holds otherwise; return the bytes written."""
        block, table = memory.blocks[slot].mapped, memory.layout.table
        before, pool = self._written.get(slot, (-1, -1)), self.lights.pool
        self._written[slot] = self._revision, pool.revision
        written = 0
        if before[0] != self._revision:
            block[:table] = self._block[:table]
            written += table
        if before[1] != pool.revision:
            words = pool.table.view(np.uint8)
            block[table : table + len(words)] = words
            written += len(words)
        return written

    @property
    def tells(self) -> bool:
        """Whether the GPU has counted what a frame draws."""
        return self.memory is not None and self._pass.counts is not None and self._pass.counts.tells

    def told(self, slot: int) -> dict[str, int]:
        """Return how many casters were drawn, and left out, in the last frame of a slot."""
        counts = self._pass.counts if self.memory is not None else None
        return counts.told(slot) if counts is not None and counts.tells else {}

    def resting(self, time: float) -> bool:
        """Whether no texture of a masked caster has arrived since the last frame."""
        return self.memory is None or self._casters.resting

    def reset(self, reason: str) -> None:
        """Choose lights and sizes anew: the next frame follows from its view alone."""
        if self.memory is not None:
            self.lights.forget()

    def close(self) -> None:
        """Free the memory."""
        if self.memory is not None:
            if self._pass.counts is not None:
                self._pass.counts.close()
            self.memory.close()
