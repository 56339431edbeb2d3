"""Primitives of a glTF file as surfaces: attributes read and repaired, modes made triangles, gaps filled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.gltf.accessors import Accessors, within
from common.gltf.document import Document
from common.gltf.geometry.completion import flat_normals, generate_tangents, smooth_normals, unit
from common.gltf.geometry.deformation import with_joints, with_targets
from common.gltf.geometry.surface import MAX_VERTICES, Surface
from common.gltf.geometry.topology import (
    LINE_STRIP,
    POINTS,
    line_ends,
    solid_lines,
    solid_points,
    triangle_indices,
)
from common.gltf.materials import MaterialKey, Materials
from common.gltf.refusal import refuse
from common.scene import Float32, UInt32

UV_LIMIT = 1e9
"""A 32-bit float of this size has no digits left for a place inside an image."""
COLOR_LIMIT = 65_504
"""The largest half: brighter vertex colours could not be drawn."""


class PrimitiveReader:
    """Reads primitives; equal arrays of several are the same object, so that they can share their place."""

    def __init__(self, document: Document, accessors: Accessors, materials: Materials) -> None:
        self._document = document
        self._accessors = accessors
        self._materials = materials
        self._attributes: dict[tuple[int, ...], dict[str, Float32]] = {}
        self._read: dict[tuple[int, int, bool, bool], tuple[Surface, MaterialKey] | None] = {}
        self._in_order: dict[int, UInt32] = {}
        self._triangles: dict[tuple[int, int], UInt32] = {}

    def read(
        self, mesh: int, number: int, skinned: bool = False, morphed: bool = False
    ) -> tuple[Surface, MaterialKey] | None:
        """Return a primitive and its material, or None where nothing of it can be seen.

        `skinned` asks for joints and weights, `morphed` for morph targets. Asked again, it gives the same
        arrays.

        Raises:
            Refusal: an attribute of the wrong type or length, an index out of range, a position that is not
                finite.
        """
        key = (mesh, number, skinned, morphed)
        if key not in self._read:
            self._read[key] = self._read_primitive(mesh, number, skinned, morphed)
        return self._read[key]

    def _read_primitive(
        self, mesh: int, number: int, skinned: bool, morphed: bool
    ) -> tuple[Surface, MaterialKey] | None:
        place = f"meshes[{mesh}].primitives[{number}]"
        entry = self._document.items("meshes")[mesh]["primitives"][number]
        attributes = entry["attributes"]
        if "POSITION" not in attributes:
            self._document.warn(f"{place} has no POSITION and was left out.")
            return None
        material = entry.get("material")
        mode = entry.get("mode", 4)
        count = self._accessors.count(attributes["POSITION"])
        if "indices" in entry:
            indices = self._accessors.indices(entry["indices"], f"{place}.indices", count)
        else:
            if count not in self._in_order:
                self._in_order[count] = np.arange(count, dtype=np.uint32)
            indices = self._in_order[count]
        if mode > LINE_STRIP:
            key = (id(indices), mode)  # the accessors keep the array alive
            indices = self._triangles.setdefault(key, triangle_indices(indices, mode))
        surface = self._vertices(attributes, indices, material, f"{place}.attributes")
        for number in self._materials.sampled_sets(material):
            if f"TEXCOORD_{number}" not in attributes:
                # glTF 2.0 (3.9.2) has no answer; the Khronos viewer and three.js read zeros where there is nothing.
                self._document.warn(
                    f"{place} has no TEXCOORD_{number}, which materials[{material}] samples: the texture is read at "
                    "(0, 0), as in other viewers."
                )
        if skinned:
            surface = with_joints(self._document, self._accessors, surface, entry, place)
        if morphed:
            surface = with_targets(self._document, self._accessors, surface, entry, place)

        if mode <= LINE_STRIP:
            lit = surface.normals is not None
            self._document.afford(8 * len(indices), place)
            return _solid(surface, mode), MaterialKey(material, unlit=not lit)
        if len(indices) == 0:
            self._document.warn(f"{place} has no triangle and was left out.")
            return None
        if surface.normals is None:
            # Flat shading needs vertices that no two triangles share; given tangents do not count (glTF 2.0,
            # 3.7.2.1).
            self._document.afford(len(indices), place)
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
                if len(source) > len(surface.positions):  # else no vertex became two
                    surface = replace(surface.take(source, indices), flat=False)
                surface = replace(surface, indices=indices, tangents=tangents)
        return surface, MaterialKey(material)

    def _vertices(
        self, attributes: dict[str, int], indices: UInt32, material: int | None, place: str
    ) -> Surface:
        accessors = self._accessors
        sets = self._materials.uv_sets(material)
        names = ("POSITION", "NORMAL", "TANGENT", f"TEXCOORD_{sets[0]}", f"TEXCOORD_{sets[1]}", "COLOR_0")
        key = tuple(attributes.get(name, -1) for name in names)
        values_by_name = self._attributes.get(key)
        if values_by_name is None:
            count = accessors.count(attributes["POSITION"])
            fields = ("positions", "normals", "tangents", "uv0", "uv1", "colors")
            types = (("VEC3",), ("VEC3",), ("VEC4",), ("VEC2",), ("VEC2",), ("VEC3", "VEC4"))
            values_by_name = {}
            for name, attribute, allowed in zip(fields, names, types, strict=True):
                if attribute in attributes:
                    spot = f"{place}.{attribute}"
                    values = accessors.floats(
                        attributes[attribute], spot, allowed, finite=name == "positions"
                    )
                    if len(values) != count:
                        refuse(spot, f"has {len(values)} elements, but POSITION has {count}")
                    values_by_name[name] = values
            if "colors" in values_by_name:
                values_by_name["colors"] = self._colors(values_by_name["colors"], f"{place}.COLOR_0")
            for name in ("uv0", "uv1"):
                if name in values_by_name and not within(values_by_name[name], UV_LIMIT):
                    self._document.warn(
                        f"{place} has texture coordinates beyond 1e9 or not finite; they became 0."
                    )
                    values_by_name[name] = np.where(
                        np.abs(values_by_name[name]) <= UV_LIMIT, values_by_name[name], np.float32(0)
                    )
            self._attributes[key] = values_by_name
        return Surface(
            values_by_name["positions"],
            indices,
            values_by_name.get("normals"),
            values_by_name.get("tangents"),
            values_by_name.get("uv0"),
            values_by_name.get("uv1"),
            values_by_name.get("colors"),
        )

    def _colors(self, values: Float32, place: str) -> Float32:
        """Return (V, 4) linear colours, not negative; what is not finite becomes white."""
        if not np.isfinite(values).all():
            self._document.warn(f"{place} has numbers that are not finite; they became 1.")
            values = np.where(np.isfinite(values), values, np.float32(1))
        colors = np.ones((len(values), 4), np.float32)
        colors[:, : values.shape[1]] = np.clip(values, 0, COLOR_LIMIT)
        return colors

    def _repair(self, surface: Surface, place: str) -> Surface:
        """Replace normals and tangents that have no direction, and give the others length 1."""
        assert surface.normals is not None
        normals, tangents = surface.normals, surface.tangents
        usable = _has_direction(normals)
        if usable.all() and tangents is None:
            return surface
        if not usable.all():
            self._document.warn(f"{place} has normals without a direction; they were made anew.")
            normals = np.where(usable[:, None], normals, smooth_normals(surface.positions, surface.indices))
        if tangents is not None and not (_has_direction(tangents[:, :3]) & np.isfinite(tangents[:, 3])).all():
            self._document.warn(
                f"{place} has tangents without a direction; all of its tangents were made anew."
            )
            tangents = None
        return replace(surface, normals=normals, tangents=tangents)


def _has_direction(vectors: Float32) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.einsum("ij,ij->i", vectors, vectors)
    return (squared > 1e-30) & (squared < np.inf)


def _solid(surface: Surface, mode: int) -> Surface:
    """Return points or lines as thin solids; see `topology`."""
    indices = surface.indices
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
