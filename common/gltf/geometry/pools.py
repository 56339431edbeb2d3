"""Surfaces packed one after another into the pools of a scene, equal vertices and indices once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.gltf.geometry.completion import any_tangents
from common.gltf.geometry.surface import MAX_VERTICES, Surface
from common.gltf.refusal import refuse
from common.numerics.arrays import fill_rows
from common.scene import MESH_DTYPE, Float32, UInt32

MAX_INDICES = 2**28


@dataclass
class Pools:
    """Surfaces waiting to be packed; vertices or indices that are the same arrays are stored once."""

    rows: list[tuple[int, int, int, int, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    bounds: list[tuple[Float32, Float32]] = field(default_factory=list)
    blocks: list[Surface] = field(default_factory=list)
    index_blocks: list[UInt32] = field(default_factory=list)
    vertex_count: int = 0
    index_count: int = 0
    _first_vertex: dict[tuple[int, ...], int] = field(default_factory=dict)
    _first_index: dict[int, int] = field(default_factory=dict)

    def add(self, surface: Surface, material: int, name: str, own: bool = False) -> int:
        """Add a mesh and return its number; `own` vertices are shared with no other mesh.

        Raises:
            Refusal: the scene would become larger than `MAX_VERTICES` or `MAX_INDICES`.
        """
        count = len(surface.positions)
        arrays = (
            surface.positions,
            surface.normals,
            surface.tangents,
            surface.uv0,
            surface.uv1,
            surface.colors,
        )
        key = tuple(map(id, arrays))
        first_vertex = None if own else self._first_vertex.get(key)
        if first_vertex is None:
            first_vertex = self.vertex_count
            self.blocks.append(surface)  # keeps the arrays alive, and with them the meaning of their ids
            self.vertex_count += count
            if not own:
                self._first_vertex[key] = first_vertex
        first_index = self._first_index.get(id(surface.indices))
        if first_index is None:
            first_index = self._first_index[id(surface.indices)] = self.index_count
            self.index_blocks.append(surface.indices)
            self.index_count += len(surface.indices)
        if self.vertex_count > MAX_VERTICES or self.index_count > MAX_INDICES:
            refuse(
                f"mesh {name!r}",
                f"brings the scene above {MAX_VERTICES} vertices or {MAX_INDICES} indices",
                "split it",
            )
        self.rows.append((first_index, len(surface.indices), first_vertex, count, material))
        self.names.append(name)
        self.bounds.append(_drawn_bounds(surface.positions, surface.indices))
        return len(self.rows) - 1

    def meshes(self) -> np.ndarray:
        """Return the table of meshes (MESH_DTYPE)."""
        table = np.zeros(len(self.rows), MESH_DTYPE)
        if self.rows:
            columns = np.array(self.rows, np.uint32).T
            for name, column in zip(MESH_DTYPE.names or (), columns, strict=False):
                table[name] = column
            table["bounds_min"], table["bounds_max"] = (
                np.array(side) for side in zip(*self.bounds, strict=True)
            )
        return table

    def vertices(self) -> dict[str, Float32 | None]:
        """Return the arrays of `Scene` by name, every block at its place."""
        total = self.vertex_count
        has_uv1 = any(block.uv1 is not None for block in self.blocks)
        has_colors = any(block.colors is not None for block in self.blocks)
        positions = fill_rows((block.positions for block in self.blocks), total, 3)
        normals = fill_rows((block.normals for block in self.blocks if block.normals is not None), total, 3)
        tangents, uv0 = np.empty((total, 4), np.float32), np.zeros((total, 2), np.float32)
        uv1 = np.zeros((total, 2), np.float32) if has_uv1 else None
        colors = np.ones((total, 4), np.float32) if has_colors else None
        present = np.zeros(total, bool)
        first = 0
        for block in self.blocks:
            place = slice(first, first + len(block.positions))
            first = place.stop
            if block.tangents is not None:
                tangents[place] = block.tangents
                present[place] = True
            if block.uv0 is not None:
                uv0[place] = block.uv0
            if uv1 is not None and block.uv1 is not None:
                uv1[place] = block.uv1
            if colors is not None and block.colors is not None:
                colors[place] = block.colors
        normals /= _lengths(normals)
        if present.all():
            tangents[:, :3] /= _lengths(tangents[:, :3])
        else:
            tangents[~present] = any_tangents(normals[~present])
            tangents[present, :3] /= _lengths(tangents[present, :3])
        tangents[:, 3] = np.where(tangents[:, 3] < 0, np.float32(-1), np.float32(1))
        return {
            "positions": positions,
            "normals": normals,
            "tangents": tangents,
            "uv0": uv0,
            "uv1": uv1,
            "colors": colors,
        }

    def indices(self) -> UInt32:
        """Return the pool of indices."""
        return np.concatenate(self.index_blocks) if self.index_blocks else np.zeros(0, np.uint32)


def _lengths(vectors: Float32) -> Float32:
    """Return (V, 1) the lengths of vectors (V, 3)."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]


def _drawn_bounds(positions: Float32, indices: UInt32) -> tuple[Float32, Float32]:
    """Return the corners of the box round the vertices that triangles use; others may lie anywhere."""
    if len(indices) < len(positions):
        drawn = positions[indices]
    else:
        used = np.zeros(len(positions), bool)
        used[indices] = True
        drawn = positions if used.all() else positions[used]
    columns = np.ascontiguousarray(drawn.T)  # along which numpy finds extremes ten times as fast
    return columns.min(axis=1), columns.max(axis=1)
