"""Random scenes with everything that hangs on nodes, and what such a scene draws, said without any numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.numerics.transforms import compose, normalize
from common.scene import (
    MESH_DTYPE,
    Animation,
    AnimationChannel,
    Deformation,
    Image,
    Instances,
    Light,
    Material,
    Nodes,
    Scene,
    SceneCamera,
    TextureRef,
)
from common.scene.pose import evaluate_pose
from tests.support.scenes import quad_scene

MESHES = 5


def forest_scene(
    seed: int = 0,
    count: int = 40,
    *,
    copies: bool = False,
    deforming: bool = False,
    animated: bool = False,
    uv1: bool = False,
    in_order: bool = True,
) -> Scene:
    """Return a random scene of 5 meshes, 4 materials and 3 images; names tell scenes and things apart.

    Mesh 1 is skinned to nodes 3 to 5 if `deforming`, and drawn by node 2 alone. A clip drives a root, node 4
    and, where there is one, the morph target.
    Not `in_order`, parents may stand behind their children.
    """
    random = np.random.default_rng(seed)
    parent = np.array([random.integers(-1, max(1, node)) if node else -1 for node in range(count)], np.int32)
    if not in_order:
        shuffled = random.permutation(count).astype(np.int32)
        moved = np.empty_like(parent)
        moved[shuffled] = np.where(parent < 0, -1, shuffled[parent])
        parent = moved
    driven = {int(np.flatnonzero(parent < 0)[0]): "rotation", 4: "translation"} if animated else {}
    has_matrix = random.random(count) < 0.3
    has_matrix[list(driven)] = False
    nodes = Nodes(
        parent=parent,
        translation=random.normal(size=(count, 3)),
        rotation=normalize(random.normal(size=(count, 4))),
        scale=random.uniform(0.5, 2.0, (count, 3)),
        matrix=compose(random.normal(size=(count, 3)), (0, 0, 0, 1), np.ones(3)),
        has_matrix=has_matrix,
        names=[f"{seed}: node {node}" for node in range(count)],
        weights={2: np.array([0.5])} if deforming else {},
        extras={5: {"note": seed}},
    )
    drawn = 30
    node, mesh = random.integers(0, count, drawn).astype(np.int32), random.integers(0, MESHES, drawn)
    mesh[mesh == 1] = 0
    node[7], mesh[7] = 2, 1
    times = np.array((0.0, 1.0))
    channels = [
        AnimationChannel(
            at, path, times, normalize(random.normal(size=(2, 4 if path == "rotation" else 3))), "linear"
        )
        for at, path in driven.items()
    ]
    if animated and deforming:
        channels.append(AnimationChannel(2, "weights", times, np.array([[0.0], [1.0]]), "linear"))
    vertices = 4 * MESHES
    meshes = np.zeros(MESHES, MESH_DTYPE)
    meshes["first_index"], meshes["index_count"] = 6 * np.arange(MESHES), 6
    meshes["first_vertex"], meshes["vertex_count"] = 4 * np.arange(MESHES), 4
    meshes["material"] = np.arange(MESHES) % 4
    meshes["bounds_min"], meshes["bounds_max"] = -1, 1
    normals = normalize(random.normal(size=(vertices, 3))).astype(np.float32)
    return replace(
        quad_scene(),
        name=f"scene {seed}",
        positions=random.uniform(-1, 1, (vertices, 3)).astype(np.float32),
        normals=normals,
        tangents=np.append(normals[:, [1, 2, 0]], np.ones((vertices, 1)), axis=1).astype(np.float32),
        uv0=random.random((vertices, 2)).astype(np.float32),
        uv1=random.random((vertices, 2)).astype(np.float32) if uv1 else None,
        indices=random.integers(0, 4, 6 * MESHES).astype(np.uint32),
        meshes=meshes,
        mesh_names=[f"{seed}: mesh {number}" for number in range(MESHES)],
        materials=[
            Material(
                f"{seed}: material {number}",
                roughness=(number + 1) / 8,
                base_color_texture=TextureRef((seed + number) % 3) if number else None,
                emissive_texture=TextureRef(2 - number, uv_set=1) if number < 3 else None,
            )
            for number in range(4)
        ],
        images=[
            Image(f"{seed}: image {number}", np.full((1, 1, 4), number, np.uint8)) for number in range(3)
        ],
        nodes=nodes,
        instances=Instances(
            node,
            mesh.astype(np.int32),
            compose(random.normal(size=(drawn, 3)), (0, 0, 0, 1), (2, 1, 1)) if copies else None,
            random.random(drawn) < 0.8,
        ),
        lights=[
            Light(kind, int(random.integers(count)), f"{seed}: {kind}") for kind in ("point", "directional")
        ],
        cameras=[SceneCamera(f"{seed}: camera", int(random.integers(count)))],
        animations=[Animation(f"{seed}: clip", tuple(channels), 1.0)] if channels else [],
        deformations=[_skin(random)] if deforming else [],
        warnings=[f"{seed}: warning"],
    )


def _skin(random: np.random.Generator) -> Deformation:
    return Deformation(
        mesh=1,
        node=2,
        joints=np.array((3, 4, 5), np.int32),
        inverse_bind=compose(random.normal(size=(3, 3)), (0, 0, 0, 1), np.ones(3)),
        vertex_joints=np.tile(np.int32((0, 1, 2, 0)), (4, 1)),
        vertex_weights=np.tile((0.5, 0.25, 0.25, 0.0), (4, 1)),
        morph_positions=random.normal(size=(1, 4, 3)).astype(np.float32),
    )


def drawn(scene: Scene, time: float = 0.0, transform: np.ndarray | None = None) -> list[tuple]:
    """Return what each instance draws, in their order: (names, visible, triangles in the world (T, 3, 3)).

    Names are those of mesh, material and, by role, images. `transform` (4, 4) multiplies all matrices.
    """
    pose = evaluate_pose(scene, time)
    found = []
    for number in range(len(scene.instances)):
        mesh = int(scene.instances.mesh[number])
        row = scene.meshes[mesh]
        first = int(row["first_vertex"])
        block = slice(first, first + int(row["vertex_count"]))
        positions = pose.vertices[mesh][0] if mesh in pose.vertices else scene.positions[block]
        matrix = pose.world_from_object[number]
        if transform is not None:
            matrix = transform @ matrix
        world = positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        indices = scene.indices[int(row["first_index"]) :][: int(row["index_count"])]
        material = scene.materials[int(row["material"])]
        textures = {role: scene.images[one.image].name for role, one in material.textures().items()}
        names = (scene.mesh_names[mesh], material.name, material.roughness, textures)
        uv = scene.uv0[block][indices].tobytes()
        found.append((names, bool(scene.instances.visible[number]), uv, world[indices].reshape(-1, 3, 3)))
    return found


def attached_places(scene: Scene, time: float = 0.0) -> list[tuple[str, np.ndarray]]:
    """Return the names of all nodes, lights and cameras with their world matrices, in order."""
    world = evaluate_pose(scene, time).world_from_node
    things = [(one.name, one.node) for one in (*scene.lights, *scene.cameras)]
    return [*zip(scene.nodes.names, world, strict=True), *((name, world[node]) for name, node in things)]


def assert_same_drawing(found: list[tuple], expected: list[tuple], exact: bool = False) -> None:
    """Assert that two results of `drawn` are the same, triangles to the bit if `exact`, else to 1e-5 of a metre."""
    assert [one[:3] for one in found] == [one[:3] for one in expected]
    for (*_, a), (*_, b) in zip(found, expected, strict=True):
        assert np.array_equal(a, b) if exact else np.allclose(a, b, rtol=1e-5, atol=1e-5)
