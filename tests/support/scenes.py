"""Scenes for tests, built in memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import MESH_DTYPE, Image, Instances, Light, Material, Nodes, Sampler, Scene, TextureRef
from common.scene.stability import moved, pixels_changed, scaled
from common.view.camera import Orthographic, View

__all__ = [
    "NEAREST",
    "facing",
    "moved",
    "nodes_at",
    "pixels_changed",
    "quad_scene",
    "scaled",
    "texture",
    "translated",
]

NEAREST = Sampler("nearest", "nearest", None)


def nodes_at(*matrices: np.ndarray) -> Nodes:
    """Return root nodes with the given (4, 4) matrices."""
    count = len(matrices)
    return Nodes(
        parent=np.full(count, -1, np.int32),
        translation=np.zeros((count, 3)),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)),
        scale=np.ones((count, 3)),
        matrix=np.array(matrices, np.float64).reshape(count, 4, 4),
        has_matrix=np.ones(count, bool),
        names=[f"node {index}" for index in range(count)],
    )


def quad_scene(
    material: Material | None = None,
    *,
    matrices: tuple[np.ndarray, ...] = (np.eye(4),),
    lights: tuple[Light, ...] = (),
    images: tuple[Image, ...] = (),
    materials: tuple[Material, ...] = (),
    instance_materials: tuple[int, ...] | None = None,
    uv_scale: float = 1.0,
    colors: np.ndarray | None = None,
) -> Scene:
    """Return squares from -1 to 1 in x and y that face +z, one per matrix; uv (0, 0) is their top left corner.

    Node i has matrix i. Square i has material `instance_materials[i]` of `materials` (or all have `material`).
    """
    materials = materials or (material or Material(),)
    count = len(materials)
    positions = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32) * np.float32(uv_scale)
    meshes = np.zeros(count, MESH_DTYPE)
    meshes["index_count"], meshes["vertex_count"] = 6, 4
    meshes["material"] = np.arange(count)
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
    chosen = instance_materials if instance_materials is not None else (0,) * len(matrices)
    return Scene(
        name="quad",
        path=None,
        positions=positions,
        normals=np.tile(np.float32((0, 0, 1)), (4, 1)),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (4, 1)),
        uv0=uv,
        uv1=None,
        colors=colors,
        indices=np.array([0, 1, 2, 0, 2, 3], np.uint32),
        meshes=meshes,
        mesh_names=["quad"] * count,
        materials=list(materials),
        images=list(images),
        nodes=nodes_at(*matrices),
        instances=Instances(
            node=np.arange(len(matrices), dtype=np.int32)[: len(chosen)], mesh=np.array(chosen, np.int32)
        ),
        lights=list(lights),
        cameras=[],
        animations=[],
        deformations=[],
    )


def texture(image: int = 0, sampler: Sampler = NEAREST, **more: object) -> TextureRef:
    """Return a use of image number `image`."""
    return TextureRef(image, sampler, **more)  # type: ignore[arg-type]


def facing(distance: float = 2.0, ymag: float = 1.0, ev100: float | None = None) -> View:
    """Return an orthographic view of the square in `quad_scene` that it fills exactly (for a square picture)."""
    pose = pose_looking_at((0.0, 0.0, distance), (0.0, 0.0, 0.0))
    view = View(pose, Orthographic(ymag, 0.1, 2.0 * distance))
    return view if ev100 is None else replace(view, ev100=ev100)


def translated(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Return the (4, 4) matrix of a translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix
