"""What the nodes of a scene draw: one instance per primitive, copies by EXT_mesh_gpu_instancing, deforming meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from common.gltf.accessors import Accessors
from common.gltf.document import Document, Object
from common.gltf.geometry.deformation import Skin, bake_targets, check_joints, read_skin, rest_weights
from common.gltf.geometry.pools import Pools
from common.gltf.geometry.primitives import PrimitiveReader
from common.gltf.geometry.surface import Surface
from common.gltf.materials import MaterialKey
from common.gltf.nodes import Forest
from common.gltf.refusal import refuse
from common.numerics.transforms import compose
from common.scene import Animation, Deformation, Float64, Instances

MAX_INSTANCES = 2**22


@dataclass
class Drawing:
    """Everything that is drawn, as it is collected.

    `materials` numbers the keys in the order of first use; `copies` are (first instance, their (K, 4, 4) transforms).
    """

    pools: Pools = field(default_factory=Pools)
    materials: dict[MaterialKey, int] = field(default_factory=dict)
    deformations: list[Deformation] = field(default_factory=list)
    node: list[int] = field(default_factory=list)
    mesh: list[int] = field(default_factory=list)
    copies: list[tuple[int, Float64]] = field(default_factory=list)

    def add(self, node: int, mesh: int, copies: Float64 | None) -> None:
        """Add an instance of a mesh at a node, or one for each of the (K, 4, 4) `copies`."""
        count = 1 if copies is None else len(copies)
        if len(self.node) + count > MAX_INSTANCES:
            refuse("the scene", f"has more than {MAX_INSTANCES} instances", "draw fewer")
        if copies is not None:
            self.copies.append((len(self.node), copies))
        self.node.extend([node] * count)
        self.mesh.extend([mesh] * count)

    def instances(self) -> Instances:
        """Return the instances in the order they were added."""
        local = None
        if any((copies != np.eye(4)).any() for _, copies in self.copies):
            local = np.tile(np.eye(4), (len(self.node), 1, 1))
            for first, copies in self.copies:
                local[first : first + len(copies)] = copies
        return Instances(np.array(self.node, np.int32), np.array(self.mesh, np.int32), local)


def read_instances(
    document: Document,
    accessors: Accessors,
    forest: Forest,
    reader: PrimitiveReader,
    animations: Sequence[Animation],
) -> Drawing:
    """Read the primitives of all nodes in the scene, in the order of the nodes in the file.

    A rigid primitive is one mesh for all nodes that draw it. One that deforms, by a skin or by morph weights
    that an animation drives, is a mesh of its own for every node. Morph weights that never change are applied
    here.

    Raises:
        Refusal: whatever is wrong with a mesh, a skin, or the attributes of instancing.
    """
    drawing = Drawing()
    driven = {channel.node for clip in animations for channel in clip.channels if channel.path == "weights"}
    skins: dict[int, Skin] = {}
    rigid: dict[tuple[int, int], int] = {}
    for index in forest.shown:
        entry = document.items("nodes")[index]
        if "mesh" not in entry:
            continue
        number, node = entry["mesh"], forest.place[index]
        mesh = document.items("meshes")[number]
        name = mesh.get("name") or f"mesh {number}"
        weights = rest_weights(document, index)
        copies = _copies(entry, accessors, index)
        for place_in_mesh, primitive in enumerate(mesh["primitives"]):
            place = f"meshes[{number}].primitives[{place_in_mesh}]"
            skinned = _is_skinned(document, entry, primitive, place)
            animated = node in driven and bool(primitive.get("targets"))
            baked = not animated and bool(primitive.get("targets")) and bool(weights.any())
            key = (number, place_in_mesh)
            if not (skinned or animated or baked) and key in rigid:
                drawing.add(node, rigid[key], copies)
                continue
            shape = reader.read(number, place_in_mesh, skinned, animated or baked)
            if shape is None:
                continue
            surface, material = shape
            if baked:
                surface = bake_targets(surface, weights)
            skin = None
            if skinned:
                if entry["skin"] not in skins:
                    skins[entry["skin"]] = read_skin(document, accessors, forest, entry["skin"])
                skin = skins[entry["skin"]]
                surface = check_joints(surface, skin, place)
                if copies is not None:
                    document.warn(f"nodes[{index}] has a skin and instances; it is drawn once.")
            before = drawing.pools.vertex_count
            row = drawing.pools.add(
                surface,
                drawing.materials.setdefault(material, len(drawing.materials)),
                name,
                skinned or animated,
            )
            document.charge(drawing.pools.vertex_count - before, place)
            if skinned or animated:
                forest.nodes.weights[node] = weights
                drawing.deformations.append(_deformation(row, node, surface, skin))
            elif not baked:
                rigid[key] = row
            drawing.add(node, row, None if skinned else copies)
    return drawing


def _is_skinned(document: Document, node: Object, primitive: Object, place: str) -> bool:
    if "skin" not in node:
        return False
    has_joints = {"JOINTS_0", "WEIGHTS_0"} <= primitive["attributes"].keys()
    if not has_joints:
        document.warn(f"{place} is drawn with a skin but has no JOINTS_0 and WEIGHTS_0; it stays rigid.")
    return has_joints


def _deformation(row: int, node: int, surface: Surface, skin: Skin | None) -> Deformation:
    return Deformation(
        mesh=row,
        node=node,
        joints=None if skin is None else skin.joints,
        inverse_bind=None if skin is None else skin.inverse_bind,
        vertex_joints=surface.joints,
        vertex_weights=surface.weights,
        morph_positions=surface.morph_positions,
        morph_normals=surface.morph_normals,
        morph_tangents=surface.morph_tangents,
        flat=surface.flat,
    )


def _copies(node: Object, accessors: Accessors, index: int) -> Float64 | None:
    """Return the (K, 4, 4) transforms of EXT_mesh_gpu_instancing, node from object, or None without it."""
    extension = (node.get("extensions") or {}).get("EXT_mesh_gpu_instancing")
    if not extension:
        return None
    place = f"nodes[{index}].extensions.EXT_mesh_gpu_instancing.attributes"
    attributes = extension["attributes"]
    parts = {
        name: accessors.floats(attributes[name], f"{place}.{name}", (kind,)).astype(np.float64)
        for name, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3"))
        if name in attributes
    }
    counts = {len(values) for values in parts.values()}
    if not counts:
        refuse(place, "has none of TRANSLATION, ROTATION and SCALE")
    if len(counts) > 1:
        refuse(place, f"have different counts: {', '.join(map(str, sorted(counts)))}")
    count = counts.pop()
    if count > MAX_INSTANCES:
        refuse(place, f"ask for {count} instances, more than {MAX_INSTANCES}", "draw fewer")
    rotation = parts.get("ROTATION", np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))
    if (np.linalg.norm(rotation, axis=1) < 1e-9).any():
        refuse(f"{place}.ROTATION", "has a zero quaternion, which is no rotation")
    translation, scale = (
        parts.get("TRANSLATION", np.zeros((count, 3))),
        parts.get("SCALE", np.ones((count, 3))),
    )
    return compose(translation, rotation, scale)
