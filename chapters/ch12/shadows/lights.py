"""The lights that cast shadows in a frame, and the faces of all of them: cascades of suns, then the slots of lamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import FrameInfo
from common.scene import Change
from common.view.camera import View

from ..page_table import rule
from ..page_table.lamps import COARSE, COARSE_STEP, Lamps, level_of_side
from ..page_table.pool import TilePool
from ..page_table.residency import Need, Residency, read_report
from ..scene.pass_parts import PassParts
from ..taa import model as taa
from . import model
from .cascades import Cascades
from .faces import FACE, UNUSED, has_cube, local_faces, reaches
from .model import CUBE_FACES, TILE

STEP = 0.005
"""How far the camera moves before lamps are chosen anew, in the scene's length scales."""

TURN = float(np.radians(1.0))
"""The angle by which it turns before."""

WIDENED = 1.05
"""The factor of reaches in the test whether a lamp is seen, for what the camera sees until then."""

_UNUSED = np.zeros((), FACE)
_UNUSED["light"] = UNUSED


class ShadowLights:
    """Chooses lights, sizes and tiles for each view, and keeps the records of their faces."""

    def __init__(self, parts: PassParts, pool: TilePool, reserve: Callable[[int], int]) -> None:
        self._parts, self.pool = parts, pool
        scene, settings = parts.scene, parts.settings
        knobs = settings.shadows
        self.held = held = parts.data.shadow_places
        self.faces = np.zeros(held.faces, FACE)
        """(F,) The records of faces; those of others have the light UNUSED."""
        self.faces["light"] = UNUSED
        self.words = np.zeros(model.padded(model.records_of(scene, settings)), np.uint32)
        """By light record: 1 + its first face, and its number of faces from bit 24 on; 0 for none."""
        self.work: dict[str, int] = {}
        self.lamps = Lamps(held.lamps, level_of_side(held.lamp_side))
        self.residency = Residency(pool, held, self.lamps, knobs.page_budget, reserve)
        self._by_need = model.by_need(settings)
        whole = held.suns * (held.cascades * held.sun_side**2 + held.coarse)
        self._sun_size = held.sun_side * TILE if whole <= pool.tiles else 0
        self._lights = -1
        self._instances: Any = None
        self._lens: Any = None
        self._cascades: Cascades | None = None
        self._chosen: View | None = None
        self._view: View | None = None
        self._suns = np.zeros(0, np.intp)
        self._frame, self._fresh = 0, True
        self._box = np.full((2, 3), np.nan)
        self._filled = np.full((3, held.lamps), -2, np.int64)
        self._report = np.zeros(0, np.uint32)
        self._need = Need(np.zeros(held.lamps), np.ones(held.coarse_word, bool))
        self._touched: Any = None
        self._mixed = np.zeros(self.residency.owners, bool)
        self._jitters, self._unmoved = taa.in_use(parts.settings), 0
        self._needed: NDArray[np.uint32] | None = None
        self.calm = False
        """Whether the last frame changed no record and no tile, and none waits."""

    def forget(self) -> None:
        """Choose anew in the next frame, whatever was chosen before."""
        self.lamps.forget()
        self._lights, self._fresh = -1, True

    def follow(
        self,
        frame: FrameInfo,
        lights: int,
        instances: int,
        report: NDArray[np.uint32] | None,
        touched: NDArray[np.bool_],
    ) -> bool:
        """Follow lights and view; return whether any record or any tile is another one.

        `lights` and `instances` are numbers of the contents of the slot's records (`Versions`). `report` is what the
        frame before the last one needed, None if it said nothing. `touched` (F,) are the faces that movers meet.
        """
        self._frame += 1
        self.pool.begin()
        self.residency.assigned = self.residency.assigned[:0]
        edits = self._parts.scene.revision
        revision = edits[Change.VISIBILITY], edits[Change.MATERIALS]
        elsewhere = (instances, revision) != self._instances  # objects, or which of them are lit and shown
        other = lights != self._lights or (elsewhere and self._box_changes(frame.slot))
        moving = (
            other
            or elsewhere
            or self._lens is None
            or not (frame.view is self._view or frame.view == self._view)
        )
        self._instances = instances, revision
        turn = not moving or self._frame % model.REPORT_EVERY == 0
        self._unmoved = 0 if moving else self._unmoved + 1
        if report is not None and self._jitters:
            report = self._over_jitter(report)
        if report is not None and (not turn or self._is_known(report)):
            report = None
        other_mix = touched is not self._touched and self._follow_mix(touched)
        unmoved = not moving and not other_mix and frame.size == self._lens[1]
        waits = (self.residency.waits and (not moving or self._frame % 2 == 0)) or (
            self.residency.ages and turn
        )
        self.calm = unmoved and report is None and not waits
        if self.calm:
            return False
        self._view = frame.view
        if other:
            self._lights = lights
            self._gather(frame.slot)
        lens = (frame.view.projection, frame.size)
        if other or lens != self._lens:
            self._lens, self._chosen = lens, None
            self._cascades = self._made_cascades(frame)
        cascades = None if self._cascades is None else self._cascades.at(frame.view)
        steps = 1 if turn else model.REPORT_EVERY
        chosen = self._chosen is None or _apart(frame.view, self._chosen, self._step, steps)
        if chosen:
            self._choose(frame)
        due = chosen or other_mix or report is not None or waits
        tiles = due and self._give_tiles(frame, report)
        if not (tiles or other or cascades is not None):
            return False
        faces = self.faces.copy()
        if other or cascades is not None:
            self._fill_suns(faces, cascades)
        if tiles or other:
            self._fill_lamps(faces, other)
        self.faces = faces
        if tiles or other or not self.work:
            self._tell(faces)
        return True

    def _box_changes(self, slot: int) -> bool:
        """Whether the box of all objects is another one."""
        records = self._parts.data.slots[slot].written["instance_records"]
        return not np.array_equal(self._bounds(records), self._box)

    def _over_jitter(self, report: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return what the frames of a view that stands still have needed, each with its own jitter.

        Their reports differ, and tiles would come and go for ever. Resolutions are the bits of positive floats.
        """
        if self._unmoved <= model.REPORTED:  # the report is that of a frame before
            self._needed = None
            return report
        if self._needed is not None:
            lamps = self.held.lamps
            most = np.maximum(report[:lamps], self._needed[:lamps])
            report = np.concatenate([most, report[lamps:] | self._needed[lamps:]])
        self._needed = report
        return report

    def _is_known(self, report: NDArray[np.uint32]) -> bool:
        """Whether a report is that on which the tiles of the last frame were based."""
        return np.array_equal(report, self._report)

    def _gather(self, slot: int) -> None:
        """Take what follows from lights and objects alone, whatever the view is."""
        scene, settings = self._parts.scene, self._parts.settings
        written = self._parts.data.slots[slot].written
        records, instances = written["light_records"], written["instance_records"]
        self._records, self._box = records, box = records, self._bounds(instances)
        self._near = settings.shadows.shadow_near * scene.length_scale
        self._step = STEP * scene.length_scale
        position = records["position"].astype(np.float64)
        placed = np.isfinite(position).all(axis=1)  # a light beyond float32 shines nowhere
        position[~placed] = 0.0
        # Beyond the far corner of the scene there is nothing to shade.
        corner = np.abs(position[:, None] - box[None]).max(axis=1)
        self._reach = np.minimum(reaches(records), 1.01 * np.linalg.norm(corner, axis=1))
        directional = records["kind"] == model.DIRECTIONAL
        peaks = records["color"].max(axis=1, initial=0.0).astype(np.float64)
        self._peaks = np.where(directional | ~placed | (self._reach <= self._near), 0.0, peaks)
        self._counts = np.where(has_cube(records), CUBE_FACES, 1)
        self._centres = position + scene.origin
        # A sun that is lost has neither light nor direction.
        suns = np.flatnonzero(directional & (peaks > 0.0))
        self._suns = suns[np.argsort(-peaks[suns], kind="stable")][: self.held.suns]

    def _bounds(self, instances: np.ndarray) -> NDArray[np.float64]:
        """Return the (2, 3) box of all lit objects, relative to the scene's origin."""
        scene = self._parts.scene
        lit = np.array([not material.unlit for material in scene.materials], bool)[instances["material"]]
        placed = np.isfinite(instances["bounds_centre"] + instances["bounds_extent"]).all(axis=1)
        chosen = instances[lit & scene.instances.visible & placed]
        if not len(chosen):
            return np.array(scene.bounds - scene.origin)
        centre, extent = (
            chosen[name][:, :3].astype(np.float64) for name in ("bounds_centre", "bounds_extent")
        )
        return np.stack([(centre - extent).min(axis=0), (centre + extent).max(axis=0)])

    def _made_cascades(self, frame: FrameInfo) -> Cascades | None:
        """Return the cascades of the suns for the lens of a view."""
        if not len(self._suns) or not self._sun_size:
            return None
        directions = self._records["direction"][self._suns].astype(np.float64)
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        settings, aspect = self._parts.settings, frame.picture[0] / frame.picture[1]
        return Cascades(
            directions,
            self._box,
            frame.view.projection,
            aspect,
            self._parts.scene.origin,
            settings.shadows.shadow_cascades,
            self._sun_size,
            int(model.guard(settings, np.array(self._sun_size))),
        )

    def _choose(self, frame: FrameInfo) -> None:
        """Choose the lamps that matter most in a view."""
        self._chosen = frame.view
        # The next frames may see a little more, before lamps are chosen again.
        widened = self._reach * WIDENED + self._step
        aspect = frame.picture[0] / frame.picture[1]
        weight = rule.importance(frame.view, aspect, self._centres, widened, self._peaks)
        self.lamps.choose(weight, self._counts, self._frame)

    def _give_tiles(self, frame: FrameInfo, report: NDArray[np.uint32] | None) -> bool:
        """Give memory to what a picture needs; return whether any tile or any size is another one.

        The first picture, and that after a cut, follow the rule for whole lights, since no frame has reported yet.
        """
        lamps, now = self.lamps, self._fresh or frame.view.cut or not self._by_need
        self._fresh = False
        if now:
            resolution = np.full(len(lamps.places), np.inf)
            if self._by_need:
                all_of_them = rule.resolutions(frame.view, frame.size[1], self._centres, self._reach)
                resolution = self._parts.settings.shadows.shadow_detail * all_of_them[lamps.places]
            lamps.since[:] = self._frame - model.REPORTED  # what is reported about this picture counts
            self._need = Need(resolution, np.ones(self.held.coarse_word, bool))
            self._report = np.zeros(0, np.uint32)
        elif report is not None:
            self._report = report
            self._need = read_report(report, self.held, self._parts.settings.shadows.shadow_detail)
        need = self._need
        if not now:  # nothing is known of lights that were chosen since
            unknown = lamps.since > self._frame - model.REPORTED
            tiles = need.tiles.copy()
            first, end = self.held.lamp_word, self.held.coarse_word
            tiles[first:end] &= np.repeat(~unknown, self.held.lamp_words)
            need = Need(np.where(unknown, 1.0, need.resolution), tiles)
        return self.residency.follow(need, now, self._mixed)

    def _follow_mix(self, touched: NDArray[np.bool_]) -> bool:
        """Note which cascades and slots have a face that movers meet; return whether these are others."""
        mixed = self._mixed_of(touched)
        changed = not np.array_equal(mixed, self._mixed)
        self._touched, self._mixed = touched, mixed
        return changed

    def _mixed_of(self, touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which cascades and slots have a face that movers meet."""
        held = self.held
        if not self._by_need or not touched.any():
            return np.zeros(self.residency.owners, bool)
        suns = touched[: held.first_lamp].reshape(held.suns, held.sun_stride)
        lamps = touched[held.first_lamp : held.first_lamp + held.lamps * held.lamp_stride]
        of_suns = suns.any(axis=1, keepdims=True) & np.ones(held.cascades, bool)
        return np.concatenate([of_suns.reshape(-1), lamps.reshape(held.lamps, held.lamp_stride).any(axis=1)])

    def _fill_suns(self, faces: np.ndarray, cascades: np.ndarray | None) -> None:
        """Place the records of cascades, and make the coarse ones."""
        held = self.held
        faces[: held.first_lamp] = _UNUSED
        if cascades is None:
            return
        suns, side = len(self._suns), held.sun_side
        rows = cascades.reshape(suns, held.cascades)
        rows["light"] = self._suns[:, None]
        rows["first"] = np.arange(rows.size).reshape(rows.shape) * side * side
        rows["tiles"] = side
        placed = faces[: suns * held.sun_stride].reshape(suns, held.sun_stride)
        placed[:, : held.cascades] = rows
        if held.coarse:
            coarse = placed[:, -1]
            coarse[:] = rows[:, -1]
            guard = float(model.guard(self._parts.settings, np.array(TILE)))
            narrower = (TILE - 2 * guard) / (self._sun_size - 2 * rows["guard"][:, -1])
            coarse["scale_x"] *= narrower
            coarse["scale_y"] *= narrower
            coarse["guard"], coarse["size"], coarse["tiles"] = guard, TILE, 1
            coarse["first"] = held.coarse_word + np.arange(suns)

    def _fill_lamps(self, faces: np.ndarray, all_of_them: bool) -> None:
        """Make the records of the lamps' faces: of those that have changed, or of all."""
        held, lamps = self.held, self.lamps
        now = np.stack([lamps.places, lamps.levels, lamps.counts])
        changed = (now != self._filled).any(axis=0) | all_of_them
        self._filled = now
        if not changed.any():
            return
        of_slots = faces[held.first_lamp : held.first_lamp + held.lamps * held.lamp_stride]
        of_slots = of_slots.reshape(held.lamps, held.lamp_stride)
        of_slots[changed] = _UNUSED
        slots = np.flatnonzero(changed & (lamps.places >= 0) & (lamps.levels > 0))
        if not len(slots):
            return
        levels, counts = lamps.levels[slots], lamps.counts[slots]
        finer = slots[levels > 1]
        sizes = lamps.sizes
        if len(finer):
            records, slot, number = self._records_of(finer, sizes[finer])
            records["tiles"] = sizes[slot] // TILE
            records["first"] = held.lamp_word + slot * held.lamp_words + number * held.lamp_side**2
            of_slots[slot, number] = records
        coarse = slots if held.coarse else slots[levels == 1]
        if len(coarse):
            least = np.where(counts[np.isin(slots, coarse)] == 1, TILE, COARSE)
            records, slot, number = self._records_of(coarse, least)
            cube = records["size"] == COARSE
            records["offset"][cube, 0] = COARSE_STEP * (number[cube] % 3)
            records["offset"][cube, 1] = COARSE_STEP * (number[cube] // 3)
            records["tiles"], records["first"] = 1, held.coarse_word + held.suns + slot
            of_slots[slot, number + held.coarse * CUBE_FACES] = records

    def _records_of(
        self, slots: NDArray[np.intp], sizes: NDArray[np.int64]
    ) -> tuple[np.ndarray, NDArray[np.intp], NDArray[np.intp]]:
        """Return the records of the faces of some slots, each with its slot and its number."""
        places, guard = self.lamps.places[slots], model.guard(self._parts.settings, sizes)
        records, owner, number = local_faces(
            self._records, places, sizes, self._near, self._reach[places], guard
        )
        return records, slots[owner], number

    def _tell(self, faces: np.ndarray) -> None:
        """Say where the faces of each light are, and count."""
        held, lamps = self.held, self.lamps
        self.words[:] = 0
        if self._sun_size and len(self._suns):
            first = np.arange(len(self._suns)) * held.sun_stride
            self.words[self._suns] = (first + 1) | held.sun_stride << 24
        slots = lamps.active
        first = held.first_lamp + slots * held.lamp_stride
        self.words[lamps.places[slots]] = (first + 1) | lamps.counts[slots] << 24
        lights = int((self.words > 0).sum())
        self.work = {
            "shadow_lights": lights,
            "shadow_lights_left_out": len(self._records) - lights,
            "shadow_lights_lowered": lamps.lowered,
            "shadow_faces": int((faces["light"] != UNUSED).sum()),
            "shadow_pages": self.pool.used,
        }


def _apart(view: View, other: View, step: float, count: int) -> bool:
    """Whether a view is `count` steps from another one, so that other lamps may matter: of a length, or a degree."""
    if not np.abs(view.eye - other.eye).max() <= count * step or view.cut:  # a NaN is apart from all
        return True
    cosines = (view.world_from_view[:3, :3] * other.world_from_view[:3, :3]).sum(axis=0)
    return not cosines.min() >= np.cos(count * TURN)
