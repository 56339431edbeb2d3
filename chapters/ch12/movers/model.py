"""Casters that move: which ones, where they are and were, and the faces that they touch. No device.

What has moved once is drawn apart from everything else: a page of casters that stand still is drawn once, and movers
are drawn over a copy of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

MOST_PAIRS = 20_000
"""Pairs of faces and boxes that are tested one by one."""

STRETCH = 1024
"""Boxes that are tested at a time against all lights, so that arrays stay small."""

NO_BOXES: Float64 = np.zeros((0, 2, 3))


class Moves(NamedTuple):
    """What has changed about casters since the frame before.

    `everything`: any may be another one. `joined` (J, 2, 3): boxes from which casters have moved for the first time;
    `before` and `now` (M, 2, 3): boxes of all that have ever moved, relative to the scene's origin. NaN stands for an
    unknown box. `moved`: whether any of them has moved in this frame.
    """

    everything: bool
    joined: Float64
    before: Float64
    now: Float64
    moved: bool


class Movers:
    """Follows the records of instances; `deforming` (N,) have no valid boxes."""

    def __init__(self, deforming: Bools) -> None:
        self._deforming = deforming
        self.moving = np.zeros(len(deforming), bool)
        """(N,) Instances that have moved."""
        self._world = np.zeros(0, np.float32)
        self._records = np.zeros(0)
        self._boxes = NO_BOXES
        self._version = -1

    def forget(self) -> None:
        """Let nothing be a mover until it moves."""
        self.moving = np.zeros_like(self.moving)
        self._boxes = NO_BOXES

    def follow(
        self, records: np.ndarray, version: int, deformed: bool, known: dict[int, Float64]
    ) -> tuple[Float64, Float64, Float64, bool]:
        """Return `joined`, `before`, `now` and `moved` of `Moves`.

        `version` numbers the places in `records`. `deformed`: whether vertices may have changed; `known` are the boxes
        (2, 3) of some instances that deform.
        """
        if version == self._version and not deformed:
            return NO_BOXES, self._boxes, self._boxes, False
        world, changed = records["world_from_object"], self._deforming & deformed
        if version != self._version and len(self._world) == len(world):
            changed = changed | (world != self._world).any(axis=(1, 2))
        elif deformed and not len(self._world):
            changed = changed & False  # the first frame
        new = np.flatnonzero(changed & ~self.moving)
        joined = self._boxes_of(self._records, new, {}) if len(new) else NO_BOXES
        moved = bool(changed.any())
        self.moving = self.moving | changed
        self._version, self._world, self._records = version, world, records
        before = np.concatenate([self._boxes, joined])
        if moved:
            self._boxes = self._boxes_of(records, np.flatnonzero(self.moving), known)
        return joined, before, self._boxes, moved

    def _boxes_of(self, records: np.ndarray, chosen: NDArray[np.intp], known: dict[int, Float64]) -> Float64:
        rows = records[chosen]
        centre, extent = (rows[name][:, :3].astype(np.float64) for name in ("bounds_centre", "bounds_extent"))
        # Places are rounded to float32 on the way to the GPU.
        extent = extent + 4e-6 * (np.abs(centre) + extent)
        boxes = np.stack([centre - extent, centre + extent], axis=1)
        boxes[self._deforming[chosen]] = np.nan
        for place, instance in enumerate(chosen.tolist()):
            if instance in known:
                boxes[place] = known[instance]
        return boxes


def _near_lights(faces: np.ndarray, boxes: Float64) -> Bools:
    """Return (F,) which faces have a light that reaches any of the boxes (M, 2, 3): too many, in less time."""
    _, first, light = np.unique(faces["light"], return_index=True, return_inverse=True)
    lights = faces[first]
    far, near = lights["far"].astype(np.float64), lights["perspective"] == 0
    for begin in range(0, len(boxes), STRETCH):
        part = boxes[begin : begin + STRETCH]
        origin = lights["origin"].astype(np.float64)[:, None]
        away = np.maximum(np.maximum(part[None, :, 0] - origin, origin - part[None, :, 1]), 0.0)
        near |= ((away * away).sum(axis=2) <= far[:, None] ** 2).any(axis=1)
    return near[light]


def touched(faces: np.ndarray, used: Bools, boxes: Float64) -> Bools:
    """Return (F,) which of the `used` faces (FACE records) any of the boxes (M, 2, 3) may be drawn to."""
    meets = np.zeros(len(faces), bool)
    if not len(boxes):
        return meets
    if np.isnan(boxes).any():
        return used.copy()
    at = np.flatnonzero(used)
    if len(at) * len(boxes) > MOST_PAIRS:
        meets[at] = _near_lights(faces[at], boxes)
        return meets
    chosen = faces[at]
    centre, half = boxes.mean(axis=1), np.ptp(boxes, axis=1) / 2  # (M, 3)
    offset = np.abs(centre[None] - chosen["origin"].astype(np.float64)[:, None])  # (F, M, 3)
    away = np.linalg.norm(np.maximum(offset - half, 0.0), axis=2)
    perspective = chosen["perspective"] > 0
    near = ((away <= chosen["far"][:, None]) | ~perspective[:, None]).any(axis=1)
    at, chosen, perspective = at[near], chosen[near], perspective[near]
    axes = np.stack([chosen["right"], chosen["down"], chosen["ahead"]], axis=1).astype(
        np.float64
    )  # (F, 3, 3)
    p = np.einsum("fij,fmj->fmi", axes, centre[None] - chosen["origin"].astype(np.float64)[:, None])
    e = np.einsum("fij,mj->fmi", np.abs(axes), half)
    scale = np.stack([chosen["scale_x"], chosen["scale_y"]], axis=1).astype(np.float64)
    wide = (chosen["size"].astype(np.float64)[:, None] / 2 / scale)[:, None]  # (F, 1, 2)
    wide = np.where(perspective[:, None, None], wide * (p[..., 2:] + e[..., 2:]), wide)
    inside = (np.abs(p[..., :2]) - e[..., :2] <= wide).all(axis=2) & (
        (p[..., 2] + e[..., 2] >= chosen["near"][:, None]) | ~perspective[:, None]
    )
    meets[at] = inside.any(axis=1)
    return meets
