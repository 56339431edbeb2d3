"""The records of the lights that are kept: directional ones first, the others in the order of the scene."""

from __future__ import annotations

import math
from operator import is_not

import numpy as np
from numpy.typing import NDArray

from common.scene import Change, Light, Pose, Scene

from ..scene.packing import FARTHEST, LARGEST, LIGHT, LIGHT_KINDS, NEAREST_END


class LightRecords:
    """Packs the lights of a scene, at most `most`; `cutoff` is the setting `light_cutoff`, in lux.

    What does not move is packed once. An edit packs the lights that it has replaced, and a pose packs none. The rest
    are operations on whole arrays.
    """

    def __init__(self, scene: Scene, cutoff: float, most: int) -> None:
        self._scene, self._cutoff, self._most = scene, cutoff, most
        self._seen = -1
        self._lights: list[
            Light
        ] = []  # as they were packed, in the order of the scene, and so are the next four
        self._all = np.zeros(0, LIGHT)
        self._peak = np.zeros(0)
        self._local = np.zeros(0, np.bool_)
        self._node = np.zeros(0, np.intp)
        self._records = np.zeros(0, LIGHT)
        self.nodes: NDArray[np.intp] = np.zeros(0, np.intp)
        """(L,) node of each light that is kept, in the order of the records."""
        self.directional = 0
        """Lights at the beginning of the records that have no place."""
        self.dark: NDArray[np.bool_] | None = None
        """(N,) nodes whose lights give none, or None."""

    def follow(self) -> None:
        """Pack the lights that edits have replaced, and choose anew."""
        revision = self._scene.revision[Change.LIGHTS]
        if revision == self._seen:
            return
        self._seen = revision
        self._pack(self._scene.lights)
        kept = brightest(self._local, self._peak, self._most)
        if len(kept) < len(self._lights):
            sentence = left_out(len(self._lights), len(kept))
            if sentence not in self._scene.warnings:
                self._scene.warnings.append(sentence)
        self.nodes = self._node[kept]
        self.directional = int(np.count_nonzero(~self._local[kept]))
        self._records = self._all.take(kept)  # indexing would copy field by field

    def _pack(self, lights: list[Light]) -> None:
        """Pack the lights that are other objects than before: a light never changes, an edit replaces it."""
        count = len(lights)
        if count != len(self._lights):
            self._all, self._peak = np.zeros(count, LIGHT), np.zeros(count)
            self._local, self._node = np.zeros(count, np.bool_), np.zeros(count, np.intp)
            replaced = np.arange(count)
        else:
            replaced = np.flatnonzero(np.fromiter(map(is_not, lights, self._lights), np.bool_, count))
        if len(replaced):
            new = [lights[number] for number in replaced]
            self._all[replaced] = packed(new, self._cutoff)
            self._peak[replaced] = peaks(new)
            self._local[replaced] = [light.kind != "directional" for light in new]
            self._node[replaced] = [light.node for light in new]
        self._lights = list(lights)

    def at(self, pose: Pose) -> np.ndarray:
        """Return (L,) LIGHT records at a pose, positions relative to the scene's origin.

        A light shines along the -z axis of its node; only the rotation of the node counts, not its scale. A light whose
        place is no number gives no light.
        """
        records = self._records.copy()
        world = pose.world_from_node[self.nodes]
        records["position"] = world[:, :3, 3] - self._scene.origin
        length = np.linalg.norm(world[:, :3, 2], axis=1)
        axis = np.where(length[:, None] > 0, -world[:, :3, 2], (0.0, 0.0, -1.0))
        records["direction"] = axis / np.where(length > 0, length, 1.0)[:, None]
        lost = ~np.isfinite(world).all(axis=(1, 2))
        if self.dark is not None:
            lost |= self.dark[self.nodes]
        if lost.any():
            for name in ("position", "direction", "color"):
                records[name][lost] = 0.0
        return records


def brightest(local: NDArray[np.bool_], peak: NDArray[np.float64], most: int) -> NDArray[np.intp]:
    """Return the numbers of the lights that are kept: directional ones first, then the others as the scene has them.

    If there are too many, the weakest are left out: of the directional ones by lux, then of the others by candela. Of
    equal ones the first stay.

    Args:
        local: (L,) whether each light has a place; directional ones have none.
        peak: (L,) intensity of the brightest channel, which is a number.
        most: how many are kept at most.
    """
    by_kind: NDArray[np.intp] = np.argsort(local, kind="stable")
    if len(local) <= most:
        return by_kind
    kept = np.zeros(len(local), np.bool_)
    kept[np.lexsort((-peak, local))[:most]] = True
    return by_kind[kept[by_kind]]


def peaks(lights: list[Light]) -> NDArray[np.float64]:
    """Return (L,) intensity of the brightest channel."""
    strongest: NDArray[np.float64] = colors(lights).max(axis=1, initial=0.0)
    return strongest


def colors(lights: list[Light]) -> NDArray[np.float64]:
    """Return (L, 3) intensity of each channel; what is negative or no number gives no light."""
    raw = np.array([light.color for light in lights]).reshape(-1, 3)
    raw = raw * np.array([light.intensity for light in lights])[:, None]
    candela: NDArray[np.float64] = np.where(raw > 0.0, raw, 0.0)
    return candela


def left_out(count: int, kept: int) -> str:
    """Return the sentence about lights that are not kept."""
    return (
        f"The scene has {count} lights, and the brightest {kept} of them are used (most_lights); {count - kept} "
        f"{'is' if count - kept == 1 else 'are'} left out."
    )


def packed(lights: list[Light], cutoff: float) -> np.ndarray:
    """Return (L,) LIGHT records without places: intensity is unexposed, in candela or lux."""
    records = np.zeros(len(lights), LIGHT)
    if not lights:
        return records
    color = colors(lights)
    inner = np.array([light.inner_cone for light in lights])
    outer = np.array([light.outer_cone for light in lights])
    local = np.array([light.kind != "directional" for light in lights])
    reach = np.array([light.range if light.kind != "directional" else math.inf for light in lights])
    records["kind"] = [LIGHT_KINDS[light.kind] for light in lights]
    records["color"] = np.clip(color, 0.0, LARGEST)
    with np.errstate(divide="ignore", over="ignore"):
        records["inverse_range2"] = np.minimum(1.0 / np.maximum(reach, 0.0), NEAREST_END) ** 2
    end = np.full(len(lights), math.inf)
    if cutoff > 0.0:
        with np.errstate(over="ignore"):  # a light of 1e300 candela has no end
            end[local] = np.sqrt(color.max(axis=1)[local] / cutoff)
    records["end_distance2"] = np.minimum(end, FARTHEST) ** 2
    # glTF: the squared, clamped line through the cosines of the two cone angles.
    scale = 1.0 / np.maximum(0.001, np.cos(inner) - np.cos(outer))
    records["cone"][:, 0], records["cone"][:, 1] = scale, -np.cos(outer) * scale
    return records
