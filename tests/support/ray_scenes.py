"""Scenes of triangles that lie anywhere, for tests of rays, and what every triangle of them is in the world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import rotation, translation
from common.scene import MESH_DTYPE, Deformation, Instances, Material, Scene
from tests.support.scenes import nodes_at

Float64 = NDArray[np.float64]


def soup(count: int, seed: int, size: float = 0.3) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return the (3 T, 3) corners of random triangles in a box of edge 2, and their indices, in no order."""
    random = np.random.default_rng(seed)
    centres = random.uniform(-1.0, 1.0, (count, 1, 3))
    corners = centres + random.uniform(-size, size, (count, 3, 3))
    indices = random.permutation(3 * count).reshape(-1, 3)
    return corners.reshape(-1, 3).astype(np.float32), indices.astype(np.uint32)


def placements() -> list[Float64]:
    """Return (4, 4) matrices: as it is, turned and scaled, squeezed along one axis, and mirrored."""
    return [
        np.eye(4),
        translation((3.0, 0.5, -1.0)) @ rotation((0.3, 1.0, 0.2), 0.8) @ np.diag((1.7, 1.7, 1.7, 1.0)),
        translation((-3.0, 0.0, 0.5)) @ rotation((1.0, 0.1, 0.0), 2.0) @ np.diag((0.5, 1.2, 0.8, 1.0)),
        translation((0.0, 3.0, 0.0)) @ np.diag((-1.0, 1.0, 1.0, 1.0)) @ rotation((0.0, 0.0, 1.0), 0.5),
    ]


def soup_scene(
    meshes: Sequence[tuple[NDArray[np.float32], NDArray[np.uint32]]],
    drawn: Sequence[tuple[int, Float64]],
    materials: Sequence[Material] = (Material(),),
    material_of: Sequence[int] | None = None,
    deforms: Sequence[int] = (),
    uv: NDArray[np.float32] | None = None,
) -> Scene:
    """Return a scene of meshes (corners, indices), of which each of `drawn` is (mesh, matrix).

    `material_of` has the material of each mesh; `deforms` are meshes whose vertices a test writes by itself.
    """
    records = np.zeros(len(meshes), MESH_DTYPE)
    vertex = index = 0
    for number, (corners, indices) in enumerate(meshes):
        record = records[number]
        record["first_vertex"], record["vertex_count"] = vertex, len(corners)
        record["first_index"], record["index_count"] = index, indices.size
        record["material"] = material_of[number] if material_of else 0
        finite = corners[np.isfinite(corners).all(axis=1)]
        if len(finite):
            record["bounds_min"], record["bounds_max"] = finite.min(axis=0), finite.max(axis=0)
        vertex, index = vertex + len(corners), index + indices.size
    positions = np.concatenate([corners for corners, _ in meshes] or [np.zeros((0, 3))]).astype(np.float32)
    every = np.concatenate([indices.reshape(-1) for _, indices in meshes] or [np.zeros(0)]).astype(np.uint32)
    return Scene(
        name="soup",
        path=None,
        positions=positions,
        normals=np.tile(np.float32((0, 0, 1)), (len(positions), 1)),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (len(positions), 1)),
        uv0=np.zeros((len(positions), 2), np.float32) if uv is None else uv,
        uv1=None,
        colors=None,
        indices=every,
        meshes=records,
        mesh_names=["soup"] * len(meshes),
        materials=list(materials),
        images=[],
        nodes=nodes_at(*[matrix for _, matrix in drawn]),
        instances=Instances(
            node=np.arange(len(drawn), dtype=np.int32), mesh=np.array([mesh for mesh, _ in drawn], np.int32)
        ),
        lights=[],
        cameras=[],
        animations=[],
        deformations=[Deformation(mesh, 0) for mesh in deforms],
    )


def world_triangles(scene: Scene) -> tuple[Float64, NDArray[np.int64]]:
    """Return (T, 3, 3) the triangles of all visible instances, and (T, 3) instance, primitive and whether mirrored.

    Positions are relative to the origin of the scene; triangles that are not finite are left out.
    """
    triangles, ids = [np.zeros((0, 3, 3))], [np.zeros((0, 3), np.int64)]
    for number, (mesh, node) in enumerate(zip(scene.instances.mesh, scene.instances.node, strict=True)):
        if not scene.instances.visible[number]:
            continue
        row, matrix = scene.meshes[mesh], scene.nodes.matrix[node]
        first, vertex = int(row["first_index"]), int(row["first_vertex"])
        indices = scene.indices[first : first + int(row["index_count"])].reshape(-1, 3)
        corners = scene.positions[vertex + indices].astype(np.float64)
        with np.errstate(invalid="ignore"):
            world = corners @ matrix[:3, :3].T + matrix[:3, 3] - scene.origin
        kept = np.isfinite(world).all(axis=(1, 2))
        mirrored = int(np.linalg.det(matrix[:3, :3]) < 0)
        own = np.stack([np.full(len(world), number), np.arange(len(world)), np.full(len(world), mirrored)], 1)
        triangles.append(world[kept])
        ids.append(own[kept])
    return np.concatenate(triangles), np.concatenate(ids)


def two_sided(scene: Scene, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (T,) whether triangles with these ids (T, 3), as of `world_triangles`, have a double-sided material."""
    of_mesh = [scene.materials[material].double_sided for material in scene.meshes["material"]]
    return np.array(of_mesh, bool)[scene.instances.mesh[ids[:, 0]]]


def random_rays(scene: Scene, count: int, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return (N, 3) origins around a scene, and directions of different lengths into it."""
    random = np.random.default_rng(seed)
    low, high = scene.bounds - scene.origin
    reach = float(np.linalg.norm(high - low)) or 1.0
    origins = random.normal(size=(count, 3))
    origins *= reach / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = random.uniform(low, high, (count, 3))
    directions = (targets - origins) * random.uniform(0.2, 2.0, (count, 1))
    return origins.astype(np.float32), directions.astype(np.float32)
