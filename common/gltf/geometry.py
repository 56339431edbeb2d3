"""Meshes of a glTF file into the pools of a scene: attributes read, repaired, completed, packed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from common.gltf.accessors import Accessors
from common.gltf.document import Document, Object
from common.gltf.materials import MaterialKey, Materials
from common.gltf.refusal import refuse
from common.gltf.surface import any_tangents, flat_normals, generate_tangents, smooth_normals, unit
from common.gltf.topology import LINE_STRIP, POINTS, line_ends, solid_lines, solid_points, triangle_indices
from common.scene import MESH_DTYPE, Float32, Float64, UInt32

MAX_VERTICES = 2**26
"""Vertices of a scene, about 4 GiB; a small file may ask for any number by naming one accessor many times."""
MAX_INDICES = 2**28


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
    joints: np.ndarray | None = None
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


class SurfaceReader:
    """Reads primitives; equal arrays of several are the same object, so that they can share their place."""

    def __init__(self, document: Document, accessors: Accessors, materials: Materials) -> None:
        self._document = document
        self._accessors = accessors
        self._materials = materials
        self._attributes: dict[tuple[int, ...], dict[str, Float32]] = {}
        self._in_order: dict[int, UInt32] = {}
        self._triangles: dict[tuple[int, int], UInt32] = {}

    def read(self, mesh: int, number: int, deforms: bool) -> tuple[Surface, MaterialKey] | None:
        """Return a primitive and its material, or None where nothing of it can be seen.

        `deforms` asks for joints, weights and morph targets.

        Raises:
            Refusal: an attribute of the wrong type or length, an index out of range, a position that is not
                finite.
        """
        place = f"meshes[{mesh}].primitives[{number}]"
        entry = self._document.items("meshes")[mesh]["primitives"][number]
        attributes = entry["attributes"]
        if "POSITION" not in attributes:
            self._document.warn(f"{place} has no POSITION and was left out.")
            return None
        material = entry.get("material")
        mode = entry.get("mode", 4)
        surface = self._vertices(attributes, material, f"{place}.attributes")
        if deforms:
            surface = self._deformation(surface, entry, place)
        count = len(surface.positions)
        if "indices" in entry:
            indices = self._accessors.indices(entry["indices"], f"{place}.indices", count)
        else:
            indices = self._in_order.setdefault(count, np.arange(count, dtype=np.uint32))

        if mode <= LINE_STRIP:
            lit = surface.normals is not None
            return _solid(surface, indices, mode), MaterialKey(material, unlit=not lit)
        key = (id(indices), mode)  # the accessors keep the array alive
        indices = self._triangles.setdefault(key, triangle_indices(indices, mode))
        if len(indices) == 0:
            self._document.warn(f"{place} has no triangle and was left out.")
            return None
        surface = replace(surface, indices=indices)
        if surface.normals is None:
            # Flat shading needs vertices that no two triangles share; given tangents do not count (glTF 2.0,
            # 3.7.2.1).
            corners = np.arange(len(indices), dtype=np.uint32)
            surface = surface.take(indices, corners)
            surface = replace(surface, normals=flat_normals(surface.positions), tangents=None, flat=True)
        else:
            surface = self._repair(surface, place)
        texture = self._materials.normal_texture(material)
        if texture is not None and surface.tangents is None:
            uv = surface.uv1 if texture.uv_set == 1 else surface.uv0
            if uv is not None and surface.normals is not None:
                image_uv = uv @ texture.matrix()[:, :2].T  # an offset changes no derivative
                source, tangents, indices = generate_tangents(
                    surface.positions, unit(surface.normals), image_uv, surface.indices
                )
                flat = surface.flat and len(source) == len(surface.positions)
                surface = replace(surface.take(source, indices), tangents=tangents, flat=flat)
        return surface, MaterialKey(material)

    def _vertices(self, attributes: dict[str, int], material: int | None, place: str) -> Surface:
        accessors = self._accessors
        sets = self._materials.uv_sets(material)
        names = ("POSITION", "NORMAL", "TANGENT", f"TEXCOORD_{sets[0]}", f"TEXCOORD_{sets[1]}", "COLOR_0")
        key = tuple(attributes.get(name, -1) for name in names)
        found = self._attributes.get(key)
        if found is None:
            count = accessors.count(attributes["POSITION"])
            fields = ("positions", "normals", "tangents", "uv0", "uv1", "colors")
            types = (("VEC3",), ("VEC3",), ("VEC4",), ("VEC2",), ("VEC2",), ("VEC3", "VEC4"))
            found = {}
            for name, attribute, allowed in zip(fields, names, types, strict=True):
                if attribute in attributes:
                    spot = f"{place}.{attribute}"
                    values = accessors.floats(
                        attributes[attribute], spot, allowed, finite=name == "positions"
                    )
                    if len(values) != count:
                        refuse(spot, f"has {len(values)} elements, but POSITION has {count}")
                    found[name] = values
            if "colors" in found:
                found["colors"] = self._colors(found["colors"], f"{place}.COLOR_0")
            for name in ("uv0", "uv1"):
                if name in found and not np.isfinite(found[name]).all():
                    self._document.warn(
                        f"{place} has texture coordinates that are not finite; they became 0."
                    )
                    found[name] = np.where(np.isfinite(found[name]), found[name], np.float32(0))
            self._attributes[key] = found
        return Surface(
            found["positions"],
            np.zeros(0, np.uint32),
            found.get("normals"),
            found.get("tangents"),
            found.get("uv0"),
            found.get("uv1"),
            found.get("colors"),
        )

    def _colors(self, values: Float32, place: str) -> Float32:
        """Return (V, 4) linear colours in [0, 1] or above; what is not finite becomes white."""
        if not np.isfinite(values).all():
            self._document.warn(f"{place} has numbers that are not finite; they became 1.")
            values = np.where(np.isfinite(values), values, np.float32(1))
        colors = np.ones((len(values), 4), np.float32)
        colors[:, : values.shape[1]] = np.maximum(values, 0)
        return colors

    def _repair(self, surface: Surface, place: str) -> Surface:
        """Replace normals and tangents that have no direction, and give the others length 1."""
        assert surface.normals is not None
        normals, tangents = surface.normals, surface.tangents
        usable = _has_direction(normals)
        if not usable.all():
            self._document.warn(f"{place} has normals without a direction; they were made anew.")
            normals = np.where(usable[:, None], normals, smooth_normals(surface.positions, surface.indices))
        if tangents is not None and not (_has_direction(tangents[:, :3]) & np.isfinite(tangents[:, 3])).all():
            self._document.warn(
                f"{place} has tangents without a direction; all of its tangents were made anew."
            )
            tangents = None
        return replace(surface, normals=normals, tangents=tangents)

    def _deformation(self, surface: Surface, entry: Object, place: str) -> Surface:
        return surface


def _has_direction(vectors: Float32) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.einsum("ij,ij->i", vectors, vectors)
    return np.isfinite(squared) & (squared > 1e-30)


def _solid(surface: Surface, indices: UInt32, mode: int) -> Surface:
    """Return points or lines as thin solids; see `topology`."""
    if len(indices) * 8 > MAX_VERTICES:
        refuse(
            "a primitive",
            f"has {len(indices)} points or line ends, more than {MAX_VERTICES // 8}",
            "split it",
        )
    if mode == POINTS:
        solid = solid_points(surface.positions, indices)
    else:
        solid = solid_lines(surface.positions, line_ends(indices, mode))
    thick = surface.take(solid.source, solid.indices)
    normals = solid.normals
    if thick.normals is not None:
        normals = np.where(_has_direction(thick.normals)[:, None], thick.normals, normals)
    return replace(thick, positions=thick.positions + solid.offset, normals=normals, tangents=None)


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
        positions, normals = np.empty((total, 3), np.float32), np.empty((total, 3), np.float32)
        tangents, uv0 = np.empty((total, 4), np.float32), np.zeros((total, 2), np.float32)
        uv1 = np.zeros((total, 2), np.float32) if has_uv1 else None
        colors = np.ones((total, 4), np.float32) if has_colors else None
        given = np.zeros(total, bool)
        first = 0
        for block in self.blocks:
            place = slice(first, first + len(block.positions))
            first = place.stop
            positions[place] = block.positions
            normals[place] = block.normals
            if block.tangents is not None:
                tangents[place] = block.tangents
                given[place] = True
            if block.uv0 is not None:
                uv0[place] = block.uv0
            if uv1 is not None and block.uv1 is not None:
                uv1[place] = block.uv1
            if colors is not None and block.colors is not None:
                colors[place] = block.colors
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if not given.all():
            tangents[~given] = any_tangents(normals[~given])
        tangents[given, :3] /= np.linalg.norm(tangents[given, :3], axis=1, keepdims=True)
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


def _drawn_bounds(positions: Float32, indices: UInt32) -> tuple[Float32, Float32]:
    """Return the corners of the box round the vertices that triangles use; others may lie anywhere."""
    used = np.zeros(len(positions), bool)
    used[indices] = True
    drawn = positions if used.all() else positions[used]
    return drawn.min(axis=0), drawn.max(axis=0)
