"""The lights that cast shadows in a frame, and the faces of all of them: cascades of suns, then the slots of lamps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import FrameInfo

from ..page_table import rule
from ..page_table.pool import TilePool
from ..scene.pass_parts import PassParts
from . import model
from .cascades import directional_faces
from .faces import FACE, UNUSED, has_cube, local_faces, reaches
from .lamps import COARSE, COARSE_STEP, Lamps
from .layout import tiles_of
from .model import CUBE_FACES


class ShadowLights:
    """Chooses lights and sizes for each view, and keeps the records of their faces."""

    def __init__(self, parts: PassParts, pool: TilePool) -> None:
        self._parts, self.pool = parts, pool
        scene, settings = parts.scene, parts.settings
        knobs = settings.shadows
        self._suns_most = model.most_suns(scene, settings)
        self._first_lamp = self._suns_most * knobs.shadow_cascades
        sun_words = self._first_lamp * int(tiles_of(np.array([knobs.shadow_sun_size]))[0])
        self.faces = np.zeros(model.most_faces(scene, settings), FACE)
        """(F,) The records of faces; those of others have the light UNUSED."""
        self.faces["light"] = UNUSED
        self.words = np.zeros(model.padded(model.records_of(scene, settings)), np.uint32)
        """By light record: 1 + its first face, and its number of faces from bit 24 on; 0 for none."""
        self.work: dict[str, int] = {}
        self.lamps = Lamps(model.most_lamps(scene, settings), knobs.shadow_size, pool, sun_words)
        self._sun_size = model.sun_size(scene, settings, pool.tiles)
        sun_tiles = int(tiles_of(np.array([self._sun_size]))[0])
        self._sun_stride = int(tiles_of(np.array([knobs.shadow_sun_size]))[0])
        held = np.arange(self._first_lamp)[:, None] * self._sun_stride + np.arange(sun_tiles)
        pool.assign(held.reshape(-1))
        self._room = pool.tiles - pool.used
        self._records: Any = None
        self._seen: Any = None
        self._edited = -1
        self._peaks = np.zeros(0)

    def forget(self) -> None:
        """Choose anew in the next frame, whatever was chosen before."""
        self.lamps.forget()
        self._seen = None

    def follow(self, frame: FrameInfo) -> bool:
        """Follow lights and view; return whether any record or any tile is another one."""
        written = self._parts.data.slots[frame.slot].written
        records, instances = written["light_records"], written["instance_records"]
        same = records is self._records or np.array_equal(records, self._records)
        seen = (frame.view, frame.size, id(instances))
        if same and seen == self._seen:
            return False
        self._records, self._seen = records, seen
        self._instances = instances  # so that no other array gets its id
        box = self._bounds(instances)
        faces = np.zeros_like(self.faces)
        faces["light"] = UNUSED
        suns = np.flatnonzero(records["kind"] == model.DIRECTIONAL)
        self._follow_suns(frame, records, suns, box, faces)
        changed = self._follow_lamps(frame, records, box, faces)
        if not changed and faces.tobytes() == self.faces.tobytes():
            return False
        self.faces = faces
        self._tell(records, faces)
        return True

    def _bounds(self, instances: np.ndarray) -> NDArray[np.float64]:
        """Return the (2, 3) box of all lit objects, relative to the scene's origin."""
        scene = self._parts.scene
        lit = np.array([not material.unlit for material in scene.materials], bool)[instances["material"]]
        chosen = instances[lit & scene.instances.visible]
        if not len(chosen):
            return np.array(scene.bounds - scene.origin)
        centre, extent = (
            chosen[name][:, :3].astype(np.float64) for name in ("bounds_centre", "bounds_extent")
        )
        return np.stack([(centre - extent).min(axis=0), (centre + extent).max(axis=0)])

    def _follow_suns(
        self,
        frame: FrameInfo,
        records: np.ndarray,
        suns: NDArray[np.intp],
        box: NDArray[np.float64],
        faces: np.ndarray,
    ) -> None:
        """Make the cascades of the brightest suns."""
        settings, scene = self._parts.settings, self._parts.scene
        brightness = records["color"][suns].max(axis=1, initial=0.0)
        suns = suns[np.argsort(-brightness, kind="stable")][: self._suns_most]
        if not len(suns) or not self._sun_size:
            return
        directions = records["direction"][suns].astype(np.float64)
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        cascades = settings.shadows.shadow_cascades
        made = directional_faces(
            directions,
            box,
            frame.view,
            scene.origin,
            frame.size[0] / frame.size[1],
            cascades,
            self._sun_size,
            model.guard(settings),
        )
        made["light"] = np.repeat(suns, cascades)
        made["first"] = np.arange(len(made)) * self._sun_stride
        made["tiles"] = -(-self._sun_size // 128)
        faces[: len(made)] = made

    def _follow_lamps(
        self, frame: FrameInfo, records: np.ndarray, box: NDArray[np.float64], faces: np.ndarray
    ) -> bool:
        """Choose lamps and their sizes, and make their faces; return whether any slot holds something else."""
        settings, lamps = self._parts.settings, self.lamps
        knobs, scene = settings.shadows, self._parts.scene
        near = knobs.shadow_near * scene.length_scale
        position = records["position"].astype(np.float64)
        # Beyond the far corner of the scene there is nothing to shade.
        corner = np.abs(position[:, None] - box[None]).max(axis=1)
        reach = np.minimum(reaches(records), 1.01 * np.linalg.norm(corner, axis=1))
        local = (records["kind"] != model.DIRECTIONAL) & (reach > near)
        counts = np.where(has_cube(records), CUBE_FACES, 1)
        aspect, centres = frame.size[0] / frame.size[1], position + scene.origin
        weight = rule.importance(
            frame.view, aspect, centres, reach, records["color"].max(axis=1, initial=0.0).astype(np.float64)
        )
        wish = np.full(len(records), np.inf)
        if knobs.shadow_memory == "pages":
            wish = knobs.shadow_detail * rule.resolutions(frame.view, frame.size[1], centres, reach)
        changed = lamps.follow(np.where(local, weight, 0.0), counts, wish, self._room)
        slots = lamps.active
        if len(slots):
            made, owner, number = local_faces(
                records,
                lamps.places[slots],
                lamps.sizes[slots],
                near,
                reach[lamps.places[slots]],
                model.guard(settings),
            )
            size, slot = lamps.sizes[slots][owner], slots[owner]
            coarse = size == COARSE
            made["offset"][coarse, 0] = COARSE_STEP * (number[coarse] % 3)
            made["offset"][coarse, 1] = COARSE_STEP * (number[coarse] // 3)
            made["tiles"] = -(-size // 128)
            made["first"] = lamps.first_words[slot] + np.where(coarse, 0, number * tiles_of(size))
            faces[self._first_lamp + CUBE_FACES * slot + number] = made
        return changed

    def _tell(self, records: np.ndarray, faces: np.ndarray) -> None:
        """Say where the faces of each light are, and count."""
        used = np.flatnonzero(faces["light"] != UNUSED)
        lights, first, counts = np.unique(faces["light"][used], return_index=True, return_counts=True)
        self.words[:] = 0
        self.words[lights] = (used[first] + 1) | counts << 24
        self.work = {
            "shadow_lights": len(lights),
            "shadow_lights_left_out": len(records) - len(lights),
            "shadow_lights_lowered": self.lamps.lowered,
            "shadow_faces": len(used),
            "shadow_pages": self.pool.used,
        }
