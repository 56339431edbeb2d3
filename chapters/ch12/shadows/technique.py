"""Shadows outside of their pass: which lights cast them, which faces a frame draws, and the buffer of its slot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import Access, FrameInfo, Pass, Technique
from common.scene import Scene

from .. import page_table
from ..cloth.passes import VERTICES
from ..clusters import model as clusters
from ..clusters.passes import read_lists
from ..frames.backend.backend import Backend
from ..movers.model import Moves, touched
from ..page_table.copies import Copies, Due
from ..page_table.passes import NEED_PASSES, NeedPass
from ..page_table.pool import TilePool
from ..page_table.refusal import tell, with_less
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .casters import Casters
from .faces import FACE, UNUSED
from .layout import ASK_BYTES, ASKS, COPIED, BlockLayout
from .lights import ShadowLights
from .lists import MOST_LAYERS, NO_ROUNDS, Pattern, Schedule, joined, schedule
from .memory import ShadowMemory
from .passes import LIT, ShadowsPass, read_pages

_NO_FACES = np.zeros(0, np.intp)


class Versions:
    """Numbers the contents of arrays, of which each slot has one. Equal contents have one number."""

    def __init__(self) -> None:
        self._of_slot: dict[int, tuple[np.ndarray, np.ndarray, int]] = {}
        self._last = 0

    def number(self, slot: int, array: np.ndarray, field: str = "") -> int:
        """Return the number of the contents of a slot's `array`, or of a field of it; another object is compared."""
        if slot in self._of_slot and self._of_slot[slot][0] is array:
            return self._of_slot[slot][2]
        # As bytes: a NaN, which equals nothing, is the same content in the next frame.
        content = np.ascontiguousarray(array[field] if field else array).view(np.uint8)
        same = [number for _, known, number in self._of_slot.values() if np.array_equal(known, content)]
        if not same:
            self._last += 1
            same = [self._last]
        self._of_slot[slot] = array, content, same[0]
        return same[0]


class ShadowTechnique(Technique):
    """Owns the memory of shadows.

    A face is drawn when its record differs from the one that it was drawn with, when tiles of it get memory, or when
    casters near it have changed. While nothing changes, the pass has no rounds, and its recording no commands.
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
        self._slot, self._had_due, self._still = -1, False, 0
        self._report: Any = None
        self._needs: Sequence[NeedPass] = ()
        self._asks: dict[int, Any] = {}
        self._pattern, self._keeps_rounds = Pattern(), False
        self._touched_for: Any = None
        self._meets, self._met = (np.zeros(0, bool),) * 2, 0
        self._met_for: Any = None
        self._lights, self._instances = Versions(), Versions()

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the passes, and let the passes that light surfaces read the pages."""
        self._parts, self._backend = parts, backend
        self._pass = own = ShadowsPass(parts)
        needs = [kind(parts) for kind in NEED_PASSES]
        self.passes = {gpu_pass.name: gpu_pass for gpu_pass in (own, *needs)}
        scene, settings = parts.scene, parts.settings
        if not model.possible(scene, settings):
            return
        if clusters.needed(scene, settings):
            read_lists(needs[:1])
        read_pages([gpu_pass for name, gpu_pass in passes.items() if name in LIT])
        cloth = passes["cloth"]
        if cloth.externals:  # its vertices are drawn, too
            own.reads = (*own.reads, Access(VERTICES, "storage", stages=("vertex",)))
        self._casters = Casters(parts, backend, own, cloth)
        held = parts.data.shadow_places
        memories = backend.part(page_table.__name__)

        def make(tiles: int) -> Any:
            return memories.make_pages(backend, tiles, held.words, model.by_need(settings))

        self.pages = with_less(make, model.pool_tiles(held, settings), scene.warnings)
        pool = TilePool(self.pages.tiles, self.pages.columns_rows, held.words, self.pages.virtual)

        def reserve(tiles: int) -> int:
            there: int = self.pages.reserve(tiles)
            tell(tiles, there, scene.warnings)
            return there

        self.lights = ShadowLights(parts, pool, reserve)
        layout = BlockLayout(
            model.records_of(scene, settings),
            held.faces,
            len(scene.materials),
            len(scene.instances),
            model.most_copies(held, settings),
            held.words,
        )
        self.memory = own.memory = backend.part(__package__).ShadowMemory(backend, layout, self.pages)
        parts.data.shadows = self.memory
        if own.culls:
            own.counts = backend.part(f"{__package__}.counts").ShadowCounts(backend)
        self._block = np.zeros(layout.size, np.uint8)
        constants: tuple[np.ndarray, ...] = model.filter_words(settings), model.place_words(settings, held)
        self._block[layout.filter : layout.records] = np.concatenate(
            [part.view(np.uint8) for part in constants]
        )
        self._copies, self._copied = Copies(held), layout.copies
        self._marks = settings.shading.view == "redrawn-pages"
        self._keeps_rounds = backend.name == "vulkan" and settings.graph.resubmit
        if model.by_need(settings):
            self._report = memories.ReportMemory(backend, held.report_words)
            self._report.asked = self._asked
            for need in needs:
                need.memory = self._report
            self._needs = needs

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
        """Give tiles to faces, and write the buffer of the slot with what is due; return the bytes written."""
        memory, own = self.memory, self._pass
        if memory is None or own not in frame.passes:
            return 0
        if frame.slot == self._slot:  # the last frame was never submitted
            self._drawn = np.zeros(0, FACE)
        self._slot = frame.slot
        written = self._parts.data.slots[frame.slot].written
        instances = self._instances.number(frame.slot, written["instance_records"], "world_from_object")
        lights = self._lights.number(frame.slot, written["light_records"])
        moves = self._casters.follow(frame, memory, instances)
        report = None if self._report is None else self._report.read(frame.slot)
        changed = self.lights.follow(frame, lights, instances, report, self._touched(moves))
        moved = moves.everything or moves.moved
        self._still = self._still + 1 if self.lights.calm and not moved else 0
        if changed or moved or not len(self._drawn):
            own.schedule = self._scheduled(moves)
            for size in {turn.size for turn in own.schedule.rounds}:
                memory.prepare(size)
            self.pages.bind(self.lights.pool)
        elif self._had_due:
            own.schedule = self._rounds_of(_NO_FACES, _NO_FACES)
        if self._still >= model.REPORTED and own.schedule.rounds:
            self._pattern.clear()
            own.schedule = NO_ROUNDS
        if own.counts is not None:
            own.counts.follow(frame.slot, own.schedule, own.lists)
        due = len(own.schedule.faces)
        if changed or due or self._had_due:
            self._revision += 1
            self._pack(memory.layout, own.schedule)
            self.work = {
                **self.lights.work,
                "shadow_faces_drawn": len(np.unique(own.schedule.faces)),
                "shadow_pages_drawn": len(self._copies.entries) if due else 0,
                "shadow_bytes": self.pages.bytes(self.lights.pool),
            }
        self._had_due = due > 0
        return self._write(memory, frame.slot) + self._ask(memory, frame)

    def _asked(self, slot: int, number: int) -> tuple[Any, int]:
        """Return where the work groups of a pass that reports are."""
        memory = self.memory
        assert memory is not None, "the technique has made it"
        return memory.blocks[slot], memory.layout.asks + ASK_BYTES * number

    def _ask(self, memory: ShadowMemory, frame: FrameInfo) -> int:
        """Say in the buffer of the slot whether its frame reports; return the bytes written."""
        if self._report is None:
            return 0
        wanted = self._still < model.REPORTED
        self._report.ask(frame.slot, wanted)
        asked = [need for need in self._needs if wanted and need in frame.passes]
        state = frame.size, tuple(need.number for need in asked)
        if self._asks.get(frame.slot) == state:
            return 0
        self._asks[frame.slot] = state
        words = np.zeros((ASKS, ASK_BYTES // 4), np.uint32)
        for need in asked:
            words[need.number, :3] = need.groups(frame.size)
        first = memory.layout.asks
        memory.blocks[frame.slot].mapped[first : first + words.nbytes] = words.view(np.uint8).reshape(-1)
        return words.nbytes

    def _touched(self, moves: Moves) -> NDArray[np.bool_]:
        """Return (F,) which faces of the last frame movers meet, here or where they were."""
        if moves.moved or self._touched_for is not self.faces:
            self._touched_for = faces = self.faces
            used = faces["light"] != UNUSED
            now = touched(faces, used, moves.now)
            before = now
            if moves.moved:
                # What was now in the last frame is before in this one, with what moves for the first time.
                known = self._met_for is faces and len(moves.before) == self._met + len(moves.joined)
                before = self._meets[0] if known else touched(faces, used, moves.before)
                before = before | touched(faces, used, moves.joined) if known else before
            self._meets, self._met, self._met_for = (now, now | before), len(moves.now), faces
        return self._meets[1]

    def _scheduled(self, moves: Moves) -> Schedule:
        """Return the rounds of the faces to draw in this frame: the largest first."""
        faces, lights, lists = self.faces, self.lights, self._pass.lists
        used = faces["light"] != UNUSED
        still = used & (moves.everything or not len(self._drawn))
        if len(self._drawn):
            rows = [each.view(np.uint8).reshape(len(faces), -1) for each in (faces, self._drawn)]
            still |= used & (rows[0] != rows[1]).any(axis=1)
        still |= touched(faces, used, moves.joined)
        meets = self._touched(moves)
        moved = meets & moves.moved
        due = Due(still, moved, self._meets[0])
        if lists is None:  # no kernel tells movers from other casters
            none = np.zeros(len(faces), bool)
            due = Due(still | moved, none, none)
        self._drawn = faces.copy()
        self._copies.choose(faces, due, lights.residency.assigned, lights.pool.table)
        first, second = (
            numbers[np.argsort(-faces["size"][numbers].astype(np.int64), kind="stable")]
            for numbers in self._copies.faces
        )
        rounds = self._rounds_of(first, second)
        if rounds.rounds:
            self._copies.place(rounds, len(first))
        return rounds

    def _rounds_of(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> Schedule:
        """Return the rounds that draw `first` without movers, and then `second` with nothing else."""
        lists, least = self._pass.lists, self._pattern.least
        most, padded = (MOST_LAYERS, False) if lists is None else (lists.layers, True)
        still = schedule(self.faces, first, most, padded, least=least(False))
        begin = len(still.drawn)
        rounds = joined(
            still, schedule(self.faces, second, most, padded, movers=True, begin=begin, least=least(True))
        )
        if self._keeps_rounds and lists is not None:
            self._pattern.learn(rounds.rounds)
        return rounds

    def _pack(self, layout: BlockLayout, due: Schedule) -> None:
        """Make the contents of the buffer, but for the table."""
        block, faces = self._block, self.faces
        block[: layout.drawn].view(np.uint32)[: len(self.lights.words)] = self.lights.words
        block[layout.drawn : layout.lists].view(np.uint32)[: len(due.drawn)] = due.drawn
        block[layout.lists : layout.blended].view(np.uint32)[: len(due.lists)] = due.lists
        blended = [material.alpha_mode == "blend" for material in self._parts.scene.materials]
        for first, chosen in (
            (layout.blended, np.array(blended, bool)),
            (layout.moving, self._casters.movers.moving),
        ):
            bits = np.packbits(chosen, bitorder="little")
            block[first : first + len(bits)] = bits
        rounds, entries = self._copies.rounds, self._copies.entries
        if not len(due.faces):
            rounds, entries = np.zeros((len(due.rounds), 4), np.uint32), entries[:0]
        rounds = rounds.copy()
        rounds[:, 3] = (layout.copies - layout.table) // 4 + 4 * rounds[:, 3]
        block[layout.rounds : layout.rounds + rounds.nbytes] = rounds.view(np.uint8).reshape(-1)
        block[layout.records : layout.records + faces.nbytes] = faces.view(np.uint8)
        self._copied = layout.copies + entries.nbytes
        block[layout.copies : self._copied] = entries.view(np.uint8).reshape(-1)

    def _write(self, memory: ShadowMemory, slot: int) -> int:
        """Write to the buffer of a slot what it holds otherwise; return the bytes written."""
        before, pool = self._written.get(slot, (-1, -1)), self.lights.pool
        if before == (self._revision, pool.revision) and not self._marks:
            return 0
        self._written[slot] = self._revision, pool.revision
        block, table, written = memory.blocks[slot].mapped, memory.layout.table, 0
        if before[0] != self._revision:
            layout = memory.layout
            for part in (
                slice(layout.asks),
                slice(layout.filter, table),
                slice(layout.copies, self._copied),
            ):
                block[part] = self._block[part]
                written += part.stop - (part.start or 0)
        if before[1] != pool.revision or self._marks:
            words = pool.table[: pool.shown].copy()
            if self._marks and len(self._pass.schedule.faces):
                words[self._copies.words] |= COPIED
            block[table : table + words.nbytes] = words.view(np.uint8)
            written += words.nbytes
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
        """Whether no texture of a masked caster has arrived since the last frame, and no tile waits for its turn."""
        if self.memory is None:
            return True
        settled = self._report is None or self._still >= model.REPORTED
        return settled and self._casters.resting

    def reset(self, reason: str) -> None:
        """Choose lights and sizes anew: the next frame follows from its view alone."""
        if self.memory is not None:
            self.lights.forget()
            if self._report is not None:
                self._report.forget()
            self._still = 0
            self._casters.movers.forget()
            self._backend.frames.wait(
                self._backend.frames.slots[self._slot]
            )  # its tiles are free from here on

    def close(self) -> None:
        """Free the memory."""
        if self.memory is not None:
            if self._pass.counts is not None:
                self._pass.counts.close()
            self.memory.close()
            self.pages.close()
        if self._report is not None:
            self._report.close()
