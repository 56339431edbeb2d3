"""A primitive of a glTF file as triangles with their vertices: what reading, completing and packing pass on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Float32, Float64, UInt32

MAX_VERTICES = 2**26
"""Vertices of a scene, about 4 GiB; a small file may ask for any number by naming one accessor many times."""


@dataclass(frozen=True)
class Surface:
    """A primitive as triangles. Arrays have one row per vertex; what the file does not have is None.

    `flat` says that the normals are those of the triangles (vertices unshared, in the order of `indices`) and
    have to be made anew where vertices move. Morph targets are (T, V, 3).
    """

    positions: Float32
    indices: UInt32
    normals: Float32 | None = None
    tangents: Float32 | None = None
    uv0: Float32 | None = None
    uv1: Float32 | None = None
    colors: Float32 | None = None
    joints: NDArray[np.int32] | None = None
    weights: Float64 | None = None
    morph_positions: Float32 | None = None
    morph_normals: Float32 | None = None
    morph_tangents: Float32 | None = None
    flat: bool = False

    def take(self, source: UInt32, indices: UInt32) -> Surface:
        """Return a surface whose vertex i copies vertex `source[i]`."""

        def rows(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[source]

        def targets(values: Float32 | None) -> Float32 | None:
            return None if values is None else values[:, source]

        return Surface(
            positions=self.positions[source],
            indices=indices,
            normals=rows(self.normals),
            tangents=rows(self.tangents),
            uv0=rows(self.uv0),
            uv1=rows(self.uv1),
            colors=rows(self.colors),
            joints=rows(self.joints),
            weights=rows(self.weights),
            morph_positions=targets(self.morph_positions),
            morph_normals=targets(self.morph_normals),
            morph_tangents=targets(self.morph_tangents),
            flat=self.flat,
        )
