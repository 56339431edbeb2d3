"""Material types: what needs a pipeline of its own, and where the things of each type stand once they are sorted by it.

Sorted by type, everything that one pipeline draws is one range, and M + 1 offsets say where the ranges of M types are:
type t has the places [offsets[t], offsets[t + 1]). The offsets are the prefix sums of the counts, so the last is the
total, and a type that does not occur has an empty range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.scene import Scene

TYPES = ("opaque", "mask", "blend")
"""In the order in which they are drawn: blended surfaces come after everything behind them."""


@dataclass(frozen=True)
class Ranges:
    """`order` (N,) int64 names N things sorted by type, equal types in their old order; `offsets` (M + 1,) int64."""

    order: NDArray[np.int64]
    offsets: NDArray[np.int64]

    def of(self, kind: int) -> NDArray[np.int64]:
        """Return the things of one type; a view."""
        return self.order[self.offsets[kind] : self.offsets[kind + 1]]

    @property
    def present(self) -> tuple[int, ...]:
        """The types that occur: those for which there is something to make and to bind."""
        return tuple(np.flatnonzero(np.diff(self.offsets)).tolist())


def prefix_offsets(counts: ArrayLike) -> NDArray[np.int64]:
    """Return the (M + 1,) places at which ranges of `counts` (M,) begin behind each other, and where the last ends."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, np.int64))]).astype(np.int64)


def sorted_by(types: ArrayLike, count: int) -> Ranges:
    """Return N things sorted by their `types` (N,), numbers below `count`; raises ValueError for another number."""
    numbers = np.asarray(types, np.int64).reshape(-1)
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        raise ValueError(f"material types are numbers from 0 to {count - 1}")
    return Ranges(np.argsort(numbers, kind="stable"), prefix_offsets(np.bincount(numbers, minlength=count)))


def material_ranges(scene: Scene) -> Ranges:
    """Return the materials of a scene by type."""
    return sorted_by([TYPES.index(material.alpha_mode) for material in scene.materials], len(TYPES))


def mesh_ranges(scene: Scene) -> Ranges:
    """Return the meshes of a scene by the type of their material."""
    kinds = np.array([TYPES.index(material.alpha_mode) for material in scene.materials], np.int64)
    return sorted_by(kinds[scene.meshes["material"]] if len(scene.meshes) else [], len(TYPES))


def index_offsets(scene: Scene, meshes: Ranges) -> NDArray[np.int64]:
    """Return (M + 1,) places of the types in a list of all indices that has the meshes in the order of `meshes`."""
    counts = scene.meshes["index_count"].astype(np.int64)
    return prefix_offsets([counts[meshes.of(kind)].sum() for kind in range(len(meshes.offsets) - 1)])
