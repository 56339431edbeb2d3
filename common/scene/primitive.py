"""One drawn object of a scene, by itself: its vertices, its matrices, its material; and scenes made from arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from common.errors import UserError
from common.numerics.transforms import normal_matrix, rotation, translation
from common.scene import MESH_DTYPE, Image, Instances, Material, Nodes, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View


@dataclass(frozen=True, eq=False)
class Primitive:
    """What is uploaded for one object; positions are relative to the centre of its box in the world."""

    positions: np.ndarray  # (V, 3) float32
    normals: np.ndarray  # (V, 3) float32, unit length
    uv: np.ndarray  # (V, 2) float32, for the base colour's picture
    indices: np.ndarray  # (T * 3,) uint32
    material: Material


def alone(scene: Scene, instance: int) -> Scene:
    """Return the scene with nothing but one of its objects, so that a camera finds it; raise UserError if it has none.

    -1 is the first object whose base colour has a picture, or the first of all.
    """
    count = len(scene.instances)
    if instance >= count:
        known = f"its objects are 0 to {count - 1}" if count else "it draws nothing"
        raise UserError(
            f"Scene {scene.name!r} has no object {max(instance, 0)}: {known}; --set instance=N chooses."
        )
    chosen = instance
    if instance < 0:
        pictured = [i for i in range(count) if material_of(scene, i).base_color_texture is not None]
        chosen = pictured[0] if pictured else 0
        if count == 0:
            raise UserError(f"Scene {scene.name!r} draws nothing: name another one with --scene.")
    held = scene.instances
    local = held.local[chosen : chosen + 1] if held.local is not None else None
    single = Instances(held.node[chosen : chosen + 1], held.mesh[chosen : chosen + 1], local)
    return replace(scene, instances=single, cameras=[])


def material_of(scene: Scene, instance: int) -> Material:
    """Return the material of an object."""
    return scene.materials[scene.meshes["material"][scene.instances.mesh[instance]]]


def primitive_of(scene: Scene) -> Primitive:
    """Return the one object of a scene that `alone` made, as it is at time 0."""
    mesh = scene.meshes[scene.instances.mesh[0]]
    number = int(scene.instances.mesh[0])
    pose = evaluate_pose(scene, 0.0)
    vertices = slice(int(mesh["first_vertex"]), int(mesh["first_vertex"] + mesh["vertex_count"]))
    indices = slice(int(mesh["first_index"]), int(mesh["first_index"] + mesh["index_count"]))
    positions: np.ndarray = scene.positions[vertices]
    normals: np.ndarray = scene.normals[vertices]
    if number in pose.vertices:  # a skin or morph targets moved them
        positions, normals = pose.vertices[number][:2]
    material = material_of(scene, 0)
    texture = material.base_color_texture
    second = texture is not None and texture.uv_set == 1 and scene.uv1 is not None
    uv: np.ndarray = scene.uv1[vertices] if second and scene.uv1 is not None else scene.uv0[vertices]
    if texture is not None:
        image_from_uv = texture.matrix()
        uv = uv @ image_from_uv[:, :2].T + image_from_uv[:, 2]
    # In double precision, and relative to the centre before anything becomes a float: see "Far from home".
    world = translation(-scene.origin) @ pose.world_from_object[0]
    placed = positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    turned = normals.astype(np.float64) @ normal_matrix(world).T
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    turned = np.divide(turned, lengths, out=np.zeros_like(turned), where=lengths > 0)
    return Primitive(
        np.ascontiguousarray(placed, np.float32),
        np.ascontiguousarray(turned, np.float32),
        np.ascontiguousarray(uv, np.float32),
        np.ascontiguousarray(scene.indices[indices], np.uint32),
        material,
    )


def matrices(scene: Scene, view: View, turn: float, aspect: float) -> np.ndarray:
    """Return view_from_object and clip_from_view, columns first (2, 4, 4) float32; `turn` is about the vertical.

    The object is given relative to its centre, and turns about that.
    """
    world_from_object = translation(scene.origin) @ rotation((0.0, 1.0, 0.0), turn)
    view_from_object = view.view_from_world() @ world_from_object
    return np.stack([view_from_object.T, view.clip_from_view(aspect).T]).astype(np.float32)


def nothing(name: str) -> Scene:
    """Return a scene in which nothing is drawn, for studies that bring what they draw."""
    return _scene(name, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), Material(), [], 0)


def scene_of(
    name: str,
    positions: ArrayLike,
    normals: ArrayLike,
    uv: ArrayLike,
    indices: ArrayLike,
    material: Material,
    images: list[Image],
) -> Scene:
    """Return a scene with one object, of vertices (V, 3), (V, 3), (V, 2) and triangles (T * 3,)."""
    arrays = [np.asarray(array) for array in (positions, normals, uv, indices)]
    return _scene(name, arrays[0], arrays[1], arrays[2], arrays[3], material, images, 1)


def cube(name: str, material: Material, images: list[Image]) -> Scene:
    """Return a cube of two metres, each face with the whole picture: 24 vertices, since faces share no uv."""
    corner = np.array([(-1, 1), (-1, -1), (1, -1), (1, 1)], np.float64)  # top left first, then around
    positions, normals = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            normal = np.roll((side, 0.0, 0.0), axis)
            up = np.array((0.0, 1.0, 0.0)) if axis != 1 else np.array((0.0, 0.0, -side))
            right = np.cross(up, normal)
            positions.append(normal + corner[:, :1] * right + corner[:, 1:] * up)
            normals.append(np.tile(normal, (4, 1)))
    # On each face the picture is turned by another quarter: the faces can be told apart.
    uv = np.concatenate([np.roll([(0, 0), (0, 1), (1, 1), (1, 0)], face, axis=0) for face in range(6)])
    indices = (4 * np.arange(6)[:, None] + np.array([0, 1, 2, 0, 2, 3])).ravel()
    return scene_of(name, np.concatenate(positions), np.concatenate(normals), uv, indices, material, images)


def _scene(
    name: str,
    positions: np.ndarray,
    normals: np.ndarray,
    uv: np.ndarray,
    indices: np.ndarray,
    material: Material,
    images: list[Image],
    count: int,
) -> Scene:
    mesh = np.zeros(count, MESH_DTYPE)
    if count:
        mesh["index_count"], mesh["vertex_count"] = len(indices), len(positions)
        mesh["bounds_min"], mesh["bounds_max"] = positions.min(axis=0), positions.max(axis=0)
    identity = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    nodes = Nodes(
        parent=np.full(count, -1, np.int32),
        translation=np.zeros((count, 3)),
        rotation=identity,
        scale=np.ones((count, 3)),
        matrix=np.tile(np.eye(4), (count, 1, 1)),
        has_matrix=np.zeros(count, bool),
        names=[name] * count,
    )
    own = np.zeros(count, np.int32)
    return Scene(
        name=name,
        path=None,
        positions=positions.astype(np.float32),
        normals=normals.astype(np.float32),
        tangents=np.zeros((len(positions), 4), np.float32),
        uv0=uv.astype(np.float32),
        uv1=None,
        colors=None,
        indices=indices.astype(np.uint32),
        meshes=mesh,
        mesh_names=[name] * count,
        materials=[material] * count,
        images=images,
        nodes=nodes,
        instances=Instances(own, own),
        lights=[],
        cameras=[],
        animations=[],
        deformations=[],
    )
