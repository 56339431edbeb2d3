"""Shadows outside of their pass: which lights cast them, which faces a frame draws, and the buffer of its slot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import Access, FrameInfo, Pass, Technique
from common.scene import Change, Scene

from ..cloth.passes import VERTICES
from ..clusters.lights import brightest
from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .cascades import directional_faces
from .faces import FACE, WIDEST_SPOT, has_cube, local_faces, reaches
from .layout import TILE_BYTES, BlockLayout, fitting_sizes, full_table, pages_size, place_tiles, tiles_of
from .lists import MOST_LAYERS, Schedule, schedule, shadow_lists
from .memory import ShadowMemory
from .passes import LIT, ShadowsPass, read_pages


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
        self._lights: Any = None
        self._lights_seen = -1
        self._casters: Any = None
        self._drawn: np.ndarray = np.zeros(0, FACE)
        self.faces = np.zeros(0, FACE)
        """The records of all faces in the last frame."""
        self.table = np.zeros(0, np.uint32)
        """Where the tiles of faces lie in the pages (layout.py)."""
        self._revision = 0
        self._written: dict[int, int] = {}
        self._slot = -1
        self._left_out = self._moves = 0
        self._had_due = False
        self._seen: Any = None
        self._records_seen = -1
        self._pose: Any = None
        self._caster_places = np.zeros(0)
        self._places = self._kept = np.zeros(0, np.intp)
        self._sizes = self._counts = np.zeros(0, np.int64)
        self._local = np.zeros(0, FACE)
        self._block = np.zeros(0, np.uint8)
        self._lists_seen: Any = None
        self._confused = False
        self._buffer_bytes = 0

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and let the passes that light surfaces read its pages."""
        self._parts, self._backend = parts, backend
        self._pass = own = ShadowsPass(parts)
        self.passes = {own.name: own}
        scene, settings = parts.scene, parts.settings
        if not model.needed(scene, settings):
            return
        read_pages([gpu_pass for name, gpu_pass in passes.items() if name in LIT])
        self._cloth = passes["cloth"]
        if self._cloth.externals:  # its vertices are drawn, too
            own.reads = (*own.reads, Access(VERTICES, "storage", stages=("vertex",)))
        own.culls = backend.plan.native("multi-draw")
        own.counts_draws = self._confused = backend.plan.native("draw-indirect-count")
        self._confused &= backend.device.capabilities.is_software  # see `ShadowMemory.unlimited`
        self._buffer_bytes = min(int(backend.device.capabilities.limits["maxStorageBufferRange"]), 1 << 27)
        self._most_tiles = (settings.shadows.shadow_pool << 20) // TILE_BYTES
        tiles = self._planned_tiles()
        layout = BlockLayout(model.records_of(scene, settings), model.most_faces(scene, settings), tiles)
        self.memory = own.memory = backend.part(__package__).ShadowMemory(backend, layout, pages_size(tiles))
        parts.data.shadows = self.memory

    def _planned_tiles(self) -> int:
        """Return the tiles that the lights ask for when the renderer is opened, as far as the pool holds them."""
        scene, settings = self._parts.scene, self._parts.settings
        numbers = np.array(brightest(scene.lights, settings.clusters.most_lights), np.intp)
        chosen = [
            scene.lights[numbers[place]]
            for place in model.selected(scene, numbers, settings.shadows.shadow_lights)
        ]
        wide = [light.kind == "point" or light.outer_cone > WIDEST_SPOT for light in chosen]
        suns = np.array([light.kind == "directional" for light in chosen], bool)
        counts, sizes = self._wishes(suns, np.array(wide, bool))
        return max(1, min(self._most_tiles, int((counts * tiles_of(sizes)).sum())))

    def _wishes(
        self, suns: NDArray[np.bool_], cubes: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (N,) number of faces and (N,) size in texels that lights ask for."""
        knobs = self._parts.settings.shadows
        counts = np.where(suns, knobs.shadow_cascades, np.where(cubes, model.CUBE_FACES, 1))
        return counts.astype(np.int64), np.where(suns, knobs.shadow_sun_size, knobs.shadow_size).astype(
            np.int64
        )

    # --- every frame ---

    def prepare(self, frame: FrameInfo) -> int:
        """Find the faces that are due, and write the buffer of the slot; return the bytes written."""
        memory, own = self.memory, self._pass
        if memory is None or own not in frame.passes:
            return 0
        if frame.slot == self._slot:  # the last frame was never submitted
            self._drawn = np.zeros(0, FACE)
        self._slot = frame.slot
        changed = self._follow_lights() | self._follow_view(frame)
        casters = self._casters_of(frame)
        due = np.arange(0)
        if changed or casters != self._casters or len(self._drawn) != len(self.faces):
            due = self._due(casters != self._casters)
            self._casters = casters
        draws = self._parts.draws
        if own.culls and draws.lists is not self._lists_seen:
            self._follow_lists(memory)
        if self._confused and own.lists is not None and draws.culled is None:
            draws.binding = draws.binding._replace(counted=memory.unlimited(draws.binding.records, own.lists))
        most = MOST_LAYERS if own.lists is None else own.lists.layers
        own.schedule = schedule(self.faces, due, most)
        for size in {turn.size for turn in own.schedule.rounds}:
            memory.prepare(size)
        if changed or len(due) or self._had_due:
            self._revision += 1
            self._pack(own.schedule)
        self._had_due = len(due) > 0
        self.work = {
            "shadow_lights": len(self._kept),
            "shadow_lights_left_out": self._left_out,
            "shadow_faces": len(self.faces),
            "shadow_faces_drawn": len(due),
            "shadow_pages": int(tiles_of(self.faces["size"].astype(np.int64)).sum()),
            "shadow_bytes": memory.tiles[0] * memory.tiles[1] * TILE_BYTES,
        }
        return self._write(memory, frame.slot)

    def _follow_lights(self) -> bool:
        """Make the faces of local lights anew if any light has changed; return whether any has."""
        records, scene = self._parts.data.records.lights, self.scene
        if records is self._lights or (self._lights is not None and np.array_equal(records, self._lights)):
            self._lights = records
            return False
        self._lights = records
        knobs, lights = self._parts.settings.shadows, self._parts.scene.lights
        revision = self.scene.revision[Change.LIGHTS]
        numbers = np.array(brightest(lights, self._parts.settings.clusters.most_lights), np.intp)
        if revision != self._lights_seen:
            self._lights_seen = revision
            self._places = model.selected(self._parts.scene, numbers, knobs.shadow_lights)
        near, far = knobs.shadow_near * scene.length_scale, reaches(records)
        places = self._places
        suns = records["kind"][places] == model.DIRECTIONAL
        places = places[suns | (far[places] > near)]
        suns = records["kind"][places] == model.DIRECTIONAL
        counts, sizes = self._wishes(suns, has_cube(records[places]))
        assert self.memory is not None, "it was needed"
        sizes = fitting_sizes(counts, sizes, self.memory.layout.tiles)
        self._kept, self._sizes, self._counts = places[sizes > 0], sizes[sizes > 0], counts[sizes > 0]
        self._left_out = len(numbers) - len(self._kept)
        local = records["kind"][self._kept] != model.DIRECTIONAL
        box = self._bounds()
        # Beyond the far corner of the scene there is nothing to shade.
        ends = np.abs(records["position"][self._kept][:, None] - box[None]).max(axis=1)
        beyond = np.minimum(far[self._kept], 1.01 * np.linalg.norm(ends, axis=1))
        self._local = local_faces(
            records,
            self._kept[local],
            self._sizes[local],
            near,
            beyond[local],
            model.guard(self._parts.settings),
        )
        self.faces = np.zeros(0, FACE)
        return True

    def _bounds(self) -> NDArray[np.float64]:
        """Return the (2, 3) box of all lit objects, relative to the scene's origin."""
        scene, instances = self._parts.scene, self._parts.data.records.instances
        lit = np.array([not material.unlit for material in scene.materials], bool)[instances["material"]]
        chosen = instances[lit & scene.instances.visible]
        if not len(chosen):
            return np.array(scene.bounds - scene.origin)
        centre, extent = (
            chosen[name][:, :3].astype(np.float64) for name in ("bounds_centre", "bounds_extent")
        )
        return np.stack([(centre - extent).min(axis=0), (centre + extent).max(axis=0)])

    def _follow_view(self, frame: FrameInfo) -> bool:
        """Make the cascades for a view; return whether any face is another one."""
        settings, scene, records = self._parts.settings, self._parts.scene, self._lights
        suns = self._kept[records["kind"][self._kept] == model.DIRECTIONAL]
        seen = (frame.view, frame.size, self._parts.data.records.revision)
        if not len(suns):
            cascades = np.zeros(0, FACE)
        elif len(self.faces) and seen == self._seen:
            return False
        else:
            directions = records["direction"][suns].astype(np.float64)
            directions /= np.linalg.norm(directions, axis=1)[:, None]
            cascades = directional_faces(
                directions,
                self._bounds(),
                frame.view,
                scene.origin,
                frame.size[0] / frame.size[1],
                settings.shadows.shadow_cascades,
                int(self._sizes[0]),
                model.guard(settings),
            )
            cascades["light"] = np.repeat(suns, settings.shadows.shadow_cascades)
        self._seen = seen
        faces = np.concatenate([cascades, self._local])
        place_tiles(faces)
        if len(faces) == len(self.faces) and faces.tobytes() == self.faces.tobytes():
            return False
        self.faces = faces
        return True

    def _casters_of(self, frame: FrameInfo) -> Any:
        """Return what the contents of all faces depend on, besides the faces themselves."""
        records, revision = self._parts.data.records, self.scene.revision
        if records.revision != self._records_seen:  # something has moved: an object, or only a light
            self._records_seen = records.revision
            places = records.instances["world_from_object"]
            deformed = bool(self.scene.deformations) and records.moving_key(frame.pose) != self._pose
            if deformed or not np.array_equal(places, self._caster_places):
                self._moves += 1
                self._caster_places = places.copy()
            self._pose = records.moving_key(frame.pose)
        self._moves += not self._cloth.resting
        return (
            revision[Change.VISIBILITY],
            revision[Change.MATERIALS],
            self._parts.data.slots[frame.slot].written.get("maps", 0),
            self._moves,
        )

    def _due(self, all_of_them: bool) -> NDArray[np.intp]:
        """Return the faces to draw in this frame, those of one size together, the largest first."""
        faces = self.faces
        same = np.zeros(len(faces), bool)
        if not all_of_them and len(self._drawn) == len(faces):
            rows = [
                np.frombuffer(each.tobytes(), np.uint8).reshape(len(faces), -1)
                for each in (faces, self._drawn)
            ]
            same = (rows[0] == rows[1]).all(axis=1)
        self._drawn = faces
        due = np.flatnonzero(~same)
        ordered: NDArray[np.intp] = due[np.argsort(-faces["size"][due].astype(np.int64), kind="stable")]
        return ordered

    def _follow_lists(self, memory: ShadowMemory) -> None:
        """Make the tables of casters anew, since other objects are drawn."""
        parts, own = self._parts, self._pass
        self._lists_seen = parts.draws.lists
        meshlets = getattr(parts.draws.culled, "meshlets", None)
        casts = [own.takes(variant) for variant in parts.data.variants]
        own.lists = shadow_lists(
            parts.draws.lists, parts.scene, meshlets, parts.data.variants, casts, self._buffer_bytes
        )
        memory.make_lists(own.lists)
        self._backend.frames.forget()

    def _pack(self, due: Schedule) -> None:
        """Make the contents of the buffer."""
        assert self.memory is not None, "it was needed"
        layout, faces = self.memory.layout, self.faces
        block = self._block = np.zeros(layout.size, np.uint8)
        first = np.cumsum(self._counts) - self._counts
        words = (first + 1) | self._counts << 24
        block[: layout.drawn].view(np.uint32)[self._kept] = words
        block[layout.drawn : layout.lists].view(np.uint32)[: len(due.drawn)] = due.drawn
        block[layout.lists : layout.records].view(np.uint32)[: len(due.lists)] = due.lists
        block[layout.records : layout.records + faces.nbytes].view(FACE)[:] = faces
        self.table = full_table(layout.tiles, self.memory.tiles[0])
        block[layout.table :].view(np.uint32)[: layout.tiles] = self.table

    def _write(self, memory: ShadowMemory, slot: int) -> int:
        """Write the buffer of a slot if it holds something else; return the bytes written."""
        if self._written.get(slot) == self._revision:
            return 0
        self._written[slot] = self._revision
        memory.blocks[slot].mapped[: len(self._block)] = self._block
        return len(self._block)

    def close(self) -> None:
        """Free the memory."""
        if self.memory is not None:
            self.memory.close()
