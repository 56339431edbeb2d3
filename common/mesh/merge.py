"""Static meshes of one material merged into one: fewer draws for the same triangles in the same places.

Worth it for thousands of small things that never move alone, as the leaves of a tree; the price is that a merged
mesh is culled, sorted and selected as a whole, and that vertices used by many instances are there many times.
"""

from __future__ import annotations

import copy
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.gltf.geometry.pools import MAX_INDICES
from common.gltf.geometry.surface import MAX_VERTICES
from common.mesh.pools import ATTRIBUTES, gathered, mesh_indices, rebuilt
from common.numerics.transforms import normal_matrix, translation
from common.scene import MESH_DTYPE, Float32, Float64, Instances, Nodes, Scene, UInt32
from common.scene.deform import tidied
from common.scene.pose import evaluate_pose


@dataclass(frozen=True)
class Merge:
    """A scene with merged meshes, and where things went: `instance` (I,) is the new number of each old instance."""

    scene: Scene
    instance: NDArray[np.int32]


def mergeable(scene: Scene) -> NDArray[np.bool_]:
    """Return (I,) which instances may become part of a merged mesh: visible, never moving, not deforming, no blend.

    Blended surfaces are drawn from back to front by instance, and an order within a mesh would be lost. So would
    which vertices `extras.strata` of a node means: those of cloth, and of what is in its way.
    """
    moving = np.zeros(len(scene.nodes), bool)
    for track in scene.tracks:
        moving[track.nodes] = True
    for level in scene.nodes.ancestry.levels[1:]:
        moving[level] |= moving[scene.nodes.parent[level]]
    for node, extras in scene.nodes.extras.items():
        said = extras.get("strata")
        moving[node] |= isinstance(said, dict) and not said.keys().isdisjoint(("cloth", "collider"))
    deforming = np.isin(scene.instances.mesh, [each.mesh for each in scene.deformations])
    blended = np.array([material.alpha_mode == "blend" for material in scene.materials], bool)
    materials = scene.meshes["material"][scene.instances.mesh]
    still = ~moving[scene.instances.node] & ~deforming & ~blended[materials]
    return scene.instances.visible & still & (scene.meshes["index_count"][scene.instances.mesh] > 0)


def merged_by_material(scene: Scene, materials: Collection[int] | None = None) -> Merge:
    """Return the scene with one mesh and one instance per material in place of the `mergeable` instances that had it.

    `materials` restricts it to some; a material that is drawn once stays as it is. A merged mesh hangs on a new root
    node. Where all its parts had the same transform the node takes that, and vertices keep their bits; otherwise
    the node stands in the middle of the parts, so that vertices stay small and precise however far they are from zero.
    Where a transform mirrors, triangles are turned round and tangents change their handedness. Draws become
    before - merged + 1 for each material. Meshes that are no longer drawn leave the scene; nodes stay, and so do
    lights, cameras and animations. What follows from boxes (bounds, origin) may become tighter.

    Raises:
        UserError: the merged scene would have more vertices or indices than a scene may have.
    """
    pose = evaluate_pose(scene, 0.0)
    material_of = scene.meshes["material"][scene.instances.mesh]
    candidates = mergeable(scene)
    groups = []
    for material in np.unique(material_of[candidates]).tolist():
        members = np.flatnonzero(candidates & (material_of == material))
        if len(members) > 1 and (materials is None or material in materials):
            groups.append(members)
    gone = np.zeros(len(scene.instances), bool)
    for members in groups:
        gone[members] = True
    was_drawn = np.isin(np.arange(len(scene.meshes)), scene.instances.mesh)
    kept = np.flatnonzero(~was_drawn | np.isin(np.arange(len(scene.meshes)), scene.instances.mesh[~gone]))
    _check_size(scene, kept, np.flatnonzero(gone))

    attributes, pool, rows, new_mesh = _kept(scene, kept)
    blocks = {name: [values] for name, values in attributes.items()}
    vertex_count, index_count = len(attributes["positions"]), sum(map(len, pool))
    matrices, names = [], [scene.mesh_names[mesh] for mesh in kept]
    for members in groups:
        matrix, parts, indices = _merged(scene, members, pose.world_from_object[members])
        for name, values in parts.items():
            blocks[name].append(values)
        material, positions = material_of[members[0]], parts["positions"]
        row = np.zeros(1, MESH_DTYPE)
        row[0] = (
            *(index_count, len(indices), vertex_count, len(positions), material),
            *(positions.min(axis=0), positions.max(axis=0)),
        )
        rows.append(row)
        pool.append(indices)
        index_count += len(indices)
        vertex_count += len(parts["positions"])
        matrices.append(matrix)
        names.append(f"merged {scene.materials[material].name or material}")

    nodes = _with_roots(scene.nodes, np.array(matrices).reshape(-1, 4, 4), names[len(kept) :])
    instances, number = _instances(scene, groups, gone, new_mesh, len(kept))
    together = {name: np.concatenate(values) for name, values in blocks.items()}
    vertices = {name: together.get(name) for name in ATTRIBUTES}
    deformations = [
        replace(each, mesh=int(new_mesh[each.mesh])) for each in scene.deformations if each.mesh in kept
    ]
    meshes = np.concatenate([np.zeros(0, MESH_DTYPE), *rows])
    result = rebuilt(
        scene,
        vertices,
        np.concatenate([np.zeros(0, np.uint32), *pool]),
        meshes,
        names,
        deformations,
        nodes,
        instances,
    )
    return Merge(result, number)


def _check_size(scene: Scene, kept: NDArray[np.intp], merged: NDArray[np.intp]) -> None:
    meshes = np.concatenate([kept, scene.instances.mesh[merged]])
    for column, most, what in (
        ("vertex_count", MAX_VERTICES, "vertices"),
        ("index_count", MAX_INDICES, "indices"),
    ):
        count = int(scene.meshes[column][meshes].sum(dtype=np.int64))
        if count > most:
            raise UserError(
                f"merging would give the scene {scene.name!r} {count} {what}, more than {most}: merge fewer materials"
            )


def _kept(
    scene: Scene, kept: NDArray[np.intp]
) -> tuple[dict[str, Float32], list[UInt32], list[np.ndarray], NDArray[np.int32]]:
    """Return vertices, indices and rows of the meshes that stay, and the new number of each old mesh, -1 if none."""
    rows = scene.meshes[kept].copy()
    pools: list[list[NDArray[np.intp]]] = []
    for first, count in (("first_vertex", "vertex_count"), ("first_index", "index_count")):
        ranges, which = np.unique(np.stack([rows[first], rows[count]], axis=1), axis=0, return_inverse=True)
        rows[first] = (np.cumsum(ranges[:, 1]) - ranges[:, 1])[which.reshape(-1)]
        pools.append([np.arange(start, start + length) for start, length in ranges.tolist()])
    source = np.concatenate([np.zeros(0, np.intp), *pools[0]])
    vertices = {name: values for name, values in gathered(scene, source).items() if values is not None}
    number = np.full(len(scene.meshes), -1, np.int32)
    number[kept] = np.arange(len(kept))
    return vertices, [scene.indices[places] for places in pools[1]], [rows], number


def _merged(
    scene: Scene, members: NDArray[np.intp], world_from_object: Float64
) -> tuple[Float64, dict[str, Float32], UInt32]:
    """Return the matrix of the new node, the vertices in its space, and the triangles of all members."""
    same = bool((world_from_object == world_from_object[0]).all())
    blocks: dict[str, list[NDArray[Any]]] = {
        name: [] for name in ATTRIBUTES if getattr(scene, name) is not None
    }
    pool = []
    vertex_count = 0
    for mesh in dict.fromkeys(scene.instances.mesh[members].tolist()):
        matrices = world_from_object[scene.instances.mesh[members] == mesh]
        copies = len(matrices)
        used, indices = np.unique(mesh_indices(scene, mesh), return_inverse=True)
        source = int(scene.meshes["first_vertex"][mesh]) + used.astype(np.intp)
        values: dict[str, Any] = dict(gathered(scene, np.tile(source, copies)))
        triangles = np.tile(indices.reshape(-1, 3), (copies, 1, 1))
        if not same:
            moved = _moved(scene, source, matrices)
            for name, part in zip(("positions", "normals", "tangents"), moved, strict=True):
                values[name] = part
            mirrored = np.linalg.det(matrices[:, :3, :3]) < 0
            triangles[mirrored] = triangles[mirrored][:, :, ::-1]
        triangles += (vertex_count + len(used) * np.arange(copies))[:, None, None]
        pool.append(triangles.reshape(-1).astype(np.uint32))
        vertex_count += copies * len(used)
        for name, block in blocks.items():
            block.append(values[name])
    together = {name: np.concatenate(block) for name, block in blocks.items()}
    matrix = world_from_object[0].copy()
    if not same:
        positions = together["positions"]
        middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
        together["positions"] = positions - middle
        matrix = translation(middle)
    vertices = {name: values.astype(np.float32) for name, values in together.items()}
    return matrix, vertices, np.concatenate(pool)


def _moved(scene: Scene, source: NDArray[np.intp], matrices: Float64) -> tuple[Float64, Float64, Float64]:
    """Return positions, normals and tangents (K V, ...) of vertices under each of K matrices, float64, world space."""
    linear = matrices[:, :3, :3]
    positions = np.einsum("kij,vj->kvi", linear, scene.positions[source]) + matrices[:, None, :3, 3]
    normals = np.einsum("kij,vj->kvi", normal_matrix(linear), scene.normals[source])
    along = np.einsum("kij,vj->kvi", linear, scene.tangents[source, :3])
    # cross(M^-T n, M t) is det(M) M b up to a positive factor: a mirror turns the bitangent round.
    sign = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)[:, None] * scene.tangents[source, 3]
    tangents = np.concatenate([along, sign[:, :, None]], axis=2)
    return tidied(positions.reshape(-1, 3), normals.reshape(-1, 3), tangents.reshape(-1, 4))


def _with_roots(nodes: Nodes, matrices: Float64, names: list[str]) -> Nodes:
    """Return the nodes followed by new roots with the given matrices (R, 4, 4)."""
    count = len(matrices)
    return Nodes(
        parent=np.concatenate([nodes.parent, np.full(count, -1, np.int32)]),
        translation=np.concatenate([nodes.translation, np.zeros((count, 3))]),
        rotation=np.concatenate([nodes.rotation, np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))]),
        scale=np.concatenate([nodes.scale, np.ones((count, 3))]),
        matrix=np.concatenate([nodes.matrix, matrices]),
        has_matrix=np.concatenate([nodes.has_matrix, np.ones(count, bool)]),
        names=[*nodes.names, *names],
        weights=copy.deepcopy(nodes.weights),
        extras=copy.deepcopy(nodes.extras),
    )


def _instances(
    scene: Scene,
    groups: list[NDArray[np.intp]],
    gone: NDArray[np.bool_],
    new_mesh: NDArray[np.int32],
    kept: int,
) -> tuple[Instances, NDArray[np.int32]]:
    """Return the instances that stay, in their order, then one per group; and the new number of each old one."""
    old, stay, new = scene.instances, np.flatnonzero(~gone), np.arange(len(groups), dtype=np.int32)
    number = np.empty(len(old), np.int32)
    number[stay] = np.arange(len(stay))
    for place, members in enumerate(groups):
        number[members] = len(stay) + place
    local = old.local
    if local is not None:
        local = np.concatenate([local[stay], np.tile(np.eye(4), (len(groups), 1, 1))])
    instances = Instances(
        np.concatenate([old.node[stay], len(scene.nodes) + new]),
        np.concatenate([new_mesh[old.mesh[stay]], kept + new]),
        local,
        np.concatenate([old.visible[stay], np.ones(len(groups), bool)]),
    )
    return instances, number
