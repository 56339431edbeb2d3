"""The lights that cast shadows in a frame, and the faces of all of them: cascades of suns, then the slots of lamps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import FrameInfo
from common.view.camera import View

from ..page_table import rule
from ..page_table.lamps import COARSE, COARSE_STEP, Lamps
from ..page_table.pool import TilePool
from ..scene.pass_parts import PassParts
from . import model
from .cascades import Cascades
from .faces import FACE, UNUSED, has_cube, local_faces, reaches
from .layout import tiles_of
from .model import CUBE_FACES

STEP = 0.005
"""How far the camera moves before lamps are chosen anew, in the scene's length scales."""

TURN = float(np.cos(np.radians(1.0)))
"""The cosine of the angle by which it turns before."""

WIDENED = 1.05
"""The factor of reaches in the test whether a lamp is seen, for what the camera sees until then."""

_UNUSED = np.zeros((), FACE)
_UNUSED["light"] = UNUSED


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
        self._lights = self._instances = -1
        self._lens: Any = None
        self._cascades: Cascades | None = None
        self._chosen: View | None = None
        self._view: View | None = None
        self._suns = np.zeros(0, np.intp)

    def forget(self) -> None:
        """Choose anew in the next frame, whatever was chosen before."""
        self.lamps.forget()
        self._lights = -1

    def follow(self, frame: FrameInfo, lights: int, instances: int) -> bool:
        """Follow lights and view; return whether any record or any tile is another one.

        `lights` and `instances` are numbers of the contents of the slot's records (`Versions`).
        """
        other = (lights, instances) != (self._lights, self._instances)
        if not other and frame.view == self._view and frame.size == self._lens[1]:
            return False
        self._view = frame.view
        if other:
            self._lights, self._instances = lights, instances
            self._gather(frame.slot)
        lens = (frame.view.projection, frame.size)
        if other or lens != self._lens:
            self._lens, self._chosen = lens, None
            self._cascades = self._made_cascades(frame)
        cascades = None if self._cascades is None else self._cascades.at(frame.view)
        lamps = (self._chosen is None or _apart(frame.view, self._chosen, self._step)) and self._choose(
            frame, other
        )
        if not (lamps or other or cascades is not None):
            return False
        faces = self.faces.copy()
        if other or cascades is not None:
            faces[: self._first_lamp] = _UNUSED
        if cascades is not None:
            cascades["light"] = np.repeat(self._suns, len(cascades) // len(self._suns))
            cascades["first"] = np.arange(len(cascades)) * self._sun_stride
            cascades["tiles"] = -(-self._sun_size // model.TILE)
            faces[: len(cascades)] = cascades
        if lamps or other:
            self._fill_lamps(faces)
        told = lamps or other or not self.work
        self.faces = faces
        if told:
            self._tell(faces)
        return True

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
        suns = np.flatnonzero(
            directional & (peaks > 0.0)
        )  # a sun that is lost has neither light nor direction
        self._suns = suns[np.argsort(-peaks[suns], kind="stable")][: self._suns_most]

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
        settings, aspect = self._parts.settings, frame.size[0] / frame.size[1]
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

    def _choose(self, frame: FrameInfo, other: bool) -> bool:
        """Choose lamps and their sizes; return whether any slot holds something else."""
        self._chosen = frame.view
        knobs, aspect = self._parts.settings.shadows, frame.size[0] / frame.size[1]
        # The next frames may see a little more, before lamps are chosen again.
        widened = self._reach * WIDENED + self._step
        weight = rule.importance(frame.view, aspect, self._centres, widened, self._peaks)
        wish = np.full(len(weight), np.inf)
        if knobs.shadow_memory == "pages":
            wish = knobs.shadow_detail * rule.resolutions(
                frame.view, frame.size[1], self._centres, self._reach
            )
        return self.lamps.follow(weight, self._counts, wish, self._room)

    def _fill_lamps(self, faces: np.ndarray) -> None:
        """Make the records of the lamps' faces."""
        lamps, faces_of = self.lamps, faces[self._first_lamp :]
        faces_of[:] = _UNUSED
        slots = lamps.active
        if not len(slots):
            return
        places, guard = lamps.places[slots], model.guard(self._parts.settings, lamps.sizes[slots])
        records, owner, number = local_faces(
            self._records, places, lamps.sizes[slots], self._near, self._reach[places], guard
        )
        size, slot = lamps.sizes[slots][owner], slots[owner]
        coarse = size == COARSE
        records["offset"][coarse, 0] = COARSE_STEP * (number[coarse] % 3)
        records["offset"][coarse, 1] = COARSE_STEP * (number[coarse] // 3)
        records["tiles"] = -(-size // model.TILE)
        records["first"] = lamps.first_words[slot] + np.where(coarse, 0, number * tiles_of(size))
        faces_of[CUBE_FACES * slot + number] = records

    def _tell(self, faces: np.ndarray) -> None:
        """Say where the faces of each light are, and count."""
        used = np.flatnonzero(faces["light"] != UNUSED)
        lights, first, counts = np.unique(faces["light"][used], return_index=True, return_counts=True)
        self.words[:] = 0
        self.words[lights] = (used[first] + 1) | counts << 24
        self.work = {
            "shadow_lights": len(lights),
            "shadow_lights_left_out": len(self._records) - len(lights),
            "shadow_lights_lowered": self.lamps.lowered,
            "shadow_faces": len(used),
            "shadow_pages": self.pool.used,
        }


def _apart(view: View, other: View, step: float) -> bool:
    """Whether a view is so far from another one that other lamps may matter: by a length, or by a degree."""
    if np.abs(view.eye - other.eye).max() > step or view.cut:
        return True
    return bool(
        np.einsum("ij,ij->j", view.world_from_view[:3, :3], other.world_from_view[:3, :3]).min() < TURN
    )
