"""The cloth of a scene: its cloths, their colliders, and the view of the scene that is drawn.

In a file `extras.strata.cloth` marks the mesh of a node as cloth, and `extras.strata.collider` marks a node as a
collider (`cloth/fields.py`). The drawn scene is a *view* of the user's scene, with the same nodes, materials and flags.
In the view each cloth has a mesh of its own. Its vertices are as they hang at the start, along the world's axes from an
anchor. So edits of the user's scene are edits of the view, and the GPU writes the vertices of each cloth separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.numerics.transforms import normal_matrix, translation
from common.scene import Deformation, Instances, Pose, Scene
from common.scene.deform import tidied
from common.scene.pose import evaluate_pose

from .build import build_cloth
from .fields import check_cloth, check_collider, named, properties
from .types import Cloth, Collider, Float64

MOST_VERTICES = 1 << 17
"""Most vertices of all cloths of a scene together: a million would take seconds a frame."""

MOST_COLLIDERS = 64

FASTEST = 20.0
"""Highest speed of a collider's centre in m/s: a faster node was placed anew, and hits nothing on its way."""

FASTEST_TURN = 1.0
"""Largest rotation of a collider in the steps of a frame, in radians: beyond it the node was placed anew."""

_ATTRIBUTES = ("positions", "normals", "tangents", "uv0", "uv1", "colors")


@dataclass(frozen=True)
class Obstacle:
    """A node with a collider, in the node's space: `radius` of a sphere, `half` of a box, `center` of both."""

    node: int
    shape: Literal["sphere", "plane", "box"]
    radius: float = 0.0
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    half: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def at(self, world_from_node: Float64) -> Collider:
        """Return the collider where the node is: scaled with it, and without shear. It is shared: write to a copy.

        Of a node that is squeezed flat only its place is left; `_obstacles` refuses such nodes at the start.
        """
        return _collider(self, world_from_node.tobytes())

    def moved(self, before: Float64, now: Float64, seconds: float) -> Collider:
        """Return the collider where its node is `now`, with its velocity since `before`, that many `seconds` ago.

        A node that was placed anew (`FASTEST`) has no velocity, and growth adds none.
        """
        here = self.at(now)
        if seconds <= 0.0 or np.array_equal(before, now):
            return here
        velocity = (here.world_from_collider - self.at(before).world_from_collider)[:3, 3] / seconds
        turn = np.zeros(3)
        if not np.array_equal(before[:3, :3], now[:3, :3]):
            turn = _turn(_rotation(now[:3, :3]) @ _rotation(before[:3, :3]).T)
        if np.linalg.norm(velocity) > FASTEST or np.linalg.norm(turn) > FASTEST_TURN:
            return here
        return replace(here, velocity=_three(velocity), spin=_three(turn / seconds))


@lru_cache(4 * MOST_COLLIDERS)  # most colliders stand still, or are asked for where they were a frame ago
def _collider(obstacle: Obstacle, placed: bytes) -> Collider:
    """Return the collider of an obstacle whose node has the world matrix with these bytes; see `Obstacle.at`."""
    world_from_node = np.frombuffer(placed).reshape(4, 4)
    linear = world_from_node[:3, :3]
    world = np.eye(4)
    if obstacle.shape == "plane":  # a plane stays a plane under any transform
        world[:3, 1] = _unit(normal_matrix(linear)[:, 1])
        world[:3, 0] = _unit(np.cross(world[:3, 1], np.eye(3)[np.abs(world[:3, 1]).argmin()]))
        world[:3, 2] = np.cross(world[:3, 0], world[:3, 1])
        world[:3, 3] = world_from_node[:3, 3]
        return Collider("plane", world)
    lengths = np.linalg.norm(linear, axis=0)
    world[:3, :3] = _rotation(linear)
    world[:3, 3] = linear @ np.array(obstacle.center) + world_from_node[:3, 3]
    if obstacle.shape == "sphere":
        return Collider("sphere", world, radius=float(obstacle.radius * lengths.max()))
    half = lengths * np.array(obstacle.half)
    return Collider("box", world, half=(float(half[0]), float(half[1]), float(half[2])))


@dataclass(frozen=True)
class ClothScene:
    """The cloths of `source`, the user's scene, and `scene`, the view that is drawn; without cloth both are the same.

    `instances` are those of the cloths, in their order. `rest` (C, 4, 4) float64 are the world matrices of their nodes
    at the start, where the cloths hang as they were modelled.
    """

    source: Scene
    scene: Scene
    cloths: tuple[Cloth, ...] = ()
    instances: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    rest: Float64 = field(default_factory=lambda: np.zeros((0, 4, 4)))
    obstacles: tuple[Obstacle, ...] = ()

    def pose(self, pose: Pose) -> Pose:
        """Return the pose of the view for one of the source: cloths stay at their anchors, whatever their nodes do."""
        if not self.cloths:
            return pose
        world = pose.world_from_object.copy()
        world[self.instances] = translation(np.array([cloth.anchor for cloth in self.cloths]))
        return replace(pose, world_from_object=world)

    def colliders(
        self, pose: Pose, before: Float64 | None = None, seconds: float = 0.0
    ) -> tuple[Collider, ...]:
        """Return the colliders at a pose; they move if their nodes were at `before` (O, 4, 4) `seconds` ago."""
        if before is None:
            return tuple(obstacle.at(pose.world_from_node[obstacle.node]) for obstacle in self.obstacles)
        return tuple(
            obstacle.moved(was, pose.world_from_node[obstacle.node], seconds)
            for obstacle, was in zip(self.obstacles, before, strict=True)
        )


def cloth_scene(scene: Scene, on: bool = True) -> ClothScene:
    """Return the cloths and colliders of a scene, with its view; without cloth, or if not `on`, the scene alone.

    Adds warnings about unusual cloths to those of the scene. Raises SceneError, which names node and field.
    """
    by_node = properties(scene.nodes, "cloth") if on else {}
    if not by_node:
        return ClothScene(scene, scene)
    pose = evaluate_pose(scene, 0.0)
    obstacles = tuple(_obstacles(scene, pose))
    instances = np.array([_instance(scene, node) for node in by_node], np.intp)
    total = int(scene.meshes["vertex_count"][scene.instances.mesh[instances]].sum(dtype=np.int64))
    if total > MOST_VERTICES:
        raise SceneError(
            f"The cloths of this scene have {total} vertices, and {MOST_VERTICES} can be simulated: take coarser "
            "meshes, or take extras.strata.cloth off some nodes."
        )
    pieces, cloths, rest = [], [], []
    for number, ((node, value), instance) in enumerate(zip(by_node.items(), instances.tolist(), strict=True)):
        node_name = named(scene.nodes, node)
        fields = check_cloth(value, node_name)
        world = pose.world_from_object[instance]
        piece = _piece(scene, int(scene.instances.mesh[instance]), world, node_name)
        pieces.append(piece)
        cloths.append(
            build_cloth(
                piece.positions,
                piece.indices.reshape(-1, 3),
                fields,
                mesh=len(scene.meshes) + number,
                node=node,
                anchor=world[:3, 3],
                name=f"of {node_name}",
            )
        )
        rest.append(pose.world_from_node[node])
    warnings = [text for cloth in cloths for text in cloth.warnings]
    scene.warnings.extend(text for text in warnings if text not in scene.warnings)
    view = _view(scene, pieces, cloths, instances)
    return ClothScene(scene, view, tuple(cloths), instances, np.array(rest), obstacles)


# --- the view ---


@dataclass(frozen=True)
class _Piece:
    """The vertices of a cloth along the world's axes from its anchor, and its triangles; `mesh` is the scene's."""

    mesh: int
    positions: Float64
    normals: Float64
    tangents: Float64
    indices: NDArray[np.uint32]


def _piece(scene: Scene, mesh: int, world_from_object: Float64, node_name: str) -> _Piece:
    row = scene.meshes[mesh]
    place = slice(int(row["first_vertex"]), int(row["first_vertex"]) + int(row["vertex_count"]))
    first = int(row["first_index"])
    indices = scene.indices[first : first + int(row["index_count"])]
    linear = world_from_object[:3, :3]
    if not np.isfinite(world_from_object).all() or np.linalg.matrix_rank(linear) < 3:
        raise SceneError(
            f"The cloth of {node_name} is squeezed flat by its node's transform: give it scales other than 0."
        )
    tangents = scene.tangents[place].astype(np.float64)
    tangents[:, :3] = tangents[:, :3] @ linear.T
    if np.linalg.det(linear) < 0:  # the vertices are mirrored now: so must be the winding
        indices = indices.reshape(-1, 3)[:, ::-1].reshape(-1)
        tangents[:, 3] = -tangents[:, 3]
    positions = scene.positions[place].astype(np.float64) @ linear.T
    normals = scene.normals[place].astype(np.float64) @ normal_matrix(linear).T
    return _Piece(mesh, *tidied(positions, normals, tangents), indices.astype(np.uint32))


def _view(
    scene: Scene, pieces: Sequence[_Piece], cloths: Sequence[Cloth], instances: NDArray[np.intp]
) -> Scene:
    """Return the scene with a mesh for each cloth after its own; edits of the scene are edits of this view of it."""
    meshes, first_vertex, first_index = [scene.meshes], len(scene.positions), len(scene.indices)
    pools: dict[str, list[NDArray[np.float32]]] = {
        name: [pool] for name in _ATTRIBUTES if (pool := getattr(scene, name)) is not None
    }
    for piece in pieces:
        row = scene.meshes[piece.mesh : piece.mesh + 1].copy()
        source = slice(int(row["first_vertex"][0]), int(row["first_vertex"][0]) + len(piece.positions))
        row["first_vertex"], row["first_index"] = first_vertex, first_index
        row["bounds_min"], row["bounds_max"] = piece.positions.min(axis=0), piece.positions.max(axis=0)
        meshes.append(row)
        for name, pool in pools.items():
            moved = getattr(piece, name, None)
            pool.append(pool[0][source] if moved is None else moved.astype(np.float32))
        first_vertex += len(piece.positions)
        first_index += len(piece.indices)
    mesh_of = scene.instances.mesh.copy()
    mesh_of[instances] = [cloth.mesh for cloth in cloths]
    deformations = [Deformation(cloth.mesh, cloth.node) for cloth in cloths]
    vertices: dict[str, Any] = {name: np.concatenate(pool) for name, pool in pools.items()}
    view = replace(
        scene,
        **vertices,
        indices=np.concatenate([scene.indices, *(piece.indices for piece in pieces)]),
        meshes=np.concatenate(meshes),
        mesh_names=[*scene.mesh_names, *(cloth.name for cloth in cloths)],
        instances=Instances(scene.instances.node, mesh_of, scene.instances.local, scene.instances.visible),
        deformations=[*scene.deformations, *deformations],
    )
    view.revision, view.bounds, view.origin = scene.revision, scene.bounds, scene.origin
    return view


# --- the properties of the file ---


def _instance(scene: Scene, node: int) -> int:
    """Return the only instance of a cloth's node. Raises SceneError for none, several, or a deformed mesh."""
    node_name, instances = named(scene.nodes, node), np.flatnonzero(scene.instances.node == node)
    if not len(instances):
        raise SceneError(
            f"{node_name.capitalize()} has extras.strata.cloth but no mesh: give it one, or take that off."
        )
    if len(instances) > 1:
        raise SceneError(
            f"The cloth of {node_name} consists of {len(instances)} primitives or copies; pins count the vertices of "
            "one: give each a node of its own."
        )
    mesh = int(scene.instances.mesh[instances[0]])
    if any(deformation.mesh == mesh for deformation in scene.deformations):
        raise SceneError(
            f"The cloth of {node_name} has a skin or morph targets: cloth moves by itself, take them off."
        )
    return int(instances[0])


def _obstacles(scene: Scene, pose: Pose) -> list[Obstacle]:
    """Return the colliders of a scene. Raises SceneError for colliders that cannot be simulated."""
    obstacles = []
    for node, value in properties(scene.nodes, "collider").items():
        node_name = named(scene.nodes, node)
        shape, radius = check_collider(value, node_name)
        linear = pose.world_from_node[node][:3, :3]
        lengths = np.linalg.norm(linear, axis=0)
        if not np.isfinite(linear).all() or lengths.min() <= 0.0 or np.linalg.matrix_rank(linear) < 3:
            raise SceneError(
                f"The collider of {node_name} is squeezed flat by its transform: give it scales other than 0."
            )
        if shape == "sphere" and lengths.max() > 1.001 * lengths.min():
            raise SceneError(
                f"The collider of {node_name} is a sphere that its transform stretches: scale all axes alike, or make "
                "it a box."
            )
        cosines = np.abs(linear.T @ linear / np.outer(lengths, lengths) - np.eye(3))
        if shape == "box" and cosines.max() > 1e-3:
            raise SceneError(
                f"The collider of {node_name} is a box that the transforms above it shear: turn and scale it in its "
                "own node."
            )
        obstacles.append(_sized(scene, node, shape, radius, node_name))
    if len(obstacles) > MOST_COLLIDERS:
        raise SceneError(
            f"This scene has {len(obstacles)} nodes with extras.strata.collider, and {MOST_COLLIDERS} can be in the "
            "way of cloth: take it off some."
        )
    return obstacles


def _sized(
    scene: Scene, node: int, shape: Literal["sphere", "plane", "box"], radius: float | None, node_name: str
) -> Obstacle:
    if shape == "plane" or radius is not None:
        return Obstacle(node, shape, radius or 0.0)
    drawn = scene.instances.mesh[scene.instances.node == node]
    if not len(drawn):
        give = "'radius_m', or a mesh" if shape == "sphere" else "a mesh"
        raise SceneError(f"The collider of {node_name} is a {shape} without a size: give it {give}.")
    low = scene.meshes["bounds_min"][drawn].min(axis=0).astype(np.float64)
    high = scene.meshes["bounds_max"][drawn].max(axis=0).astype(np.float64)
    half = (high - low) / 2
    if shape == "sphere":
        return Obstacle(node, shape, float(half.max()), _three((low + high) / 2))
    return Obstacle(node, shape, 0.0, _three((low + high) / 2), _three(half))


def _three(values: Float64) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _unit(vector: Float64) -> Float64:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.array((0.0, 1.0, 0.0))


def _rotation(linear: Float64) -> Float64:
    """Return the rotation nearest to a matrix, by its singular vectors; a singular matrix gets some rotation."""
    left, _, right = np.linalg.svd(linear)
    rotation: Float64 = left @ right
    if np.linalg.det(rotation) < 0:  # mirrored: spheres and boxes are the same from either side
        rotation = rotation * np.array((-1.0, 1.0, 1.0))
    return rotation


def _turn(rotation: Float64) -> Float64:
    """Return the axis (3,) of a rotation, as long as its angle in radians."""
    axis = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis)) / 2
    angle = float(np.arctan2(sine, (np.trace(rotation) - 1.0) / 2))
    if sine > 0.0:
        turned: Float64 = axis * (angle / (2 * sine))
        return turned
    return np.array((angle, 0.0, 0.0))  # no turn, or half a turn: more than FASTEST_TURN about any axis
