"""Scenes for tests, built in memory, and scenes moved, scaled and spoiled in one stated way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.camera import Orthographic, Perspective, View
from common.scene import MESH_DTYPE, Image, Instances, Light, Material, Nodes, Sampler, Scene, SceneCamera, TextureRef
from common.transforms import pose_looking_at

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


def _transformed(scene: Scene, world: np.ndarray) -> Nodes:
    """Return the scene's nodes under a new root transform `world` (4, 4)."""
    from common.transforms import compose

    nodes = scene.nodes
    local = compose(nodes.translation, nodes.rotation, nodes.scale)
    local[nodes.has_matrix] = nodes.matrix[nodes.has_matrix]
    roots = nodes.parent < 0
    matrix, has_matrix = nodes.matrix.copy(), nodes.has_matrix.copy()
    matrix[roots] = world @ local[roots]
    has_matrix[roots] = True
    return replace(nodes, matrix=matrix, has_matrix=has_matrix)


def moved(scene: Scene, view: View, offset: tuple[float, float, float]) -> tuple[Scene, View]:
    """Return scene and view moved by `offset` metres: the picture stays the same."""
    by = translated(*offset)
    return replace(scene, nodes=_transformed(scene, by)), replace(view, world_from_view=by @ view.world_from_view)


def scaled(scene: Scene, view: View, factor: float) -> tuple[Scene, View]:
    """Return scene and view scaled about zero: lengths times `factor`, candelas times its square, lux unchanged."""
    by = np.diag((factor, factor, factor, 1.0))
    lights = [
        light
        if light.kind == "directional"
        else replace(light, intensity=light.intensity * factor**2, range=light.range * factor)
        for light in scene.lights
    ]
    cameras = [
        replace(c, near=c.near * factor, far=c.far * factor, ymag=c.ymag * factor) if isinstance(c, SceneCamera) else c
        for c in scene.cameras
    ]
    pose = view.world_from_view.copy()
    pose[:3, 3] *= factor
    projection: Perspective | Orthographic
    if isinstance(view.projection, Perspective):
        projection = replace(view.projection, near=view.projection.near * factor)
    else:
        p = view.projection
        projection = Orthographic(p.ymag * factor, p.near * factor, p.far * factor)
    changed = replace(scene, nodes=_transformed(scene, by), lights=lights, cameras=cameras)
    return changed, replace(view, world_from_view=pose, projection=projection)


def pixels_changed(a: np.ndarray, b: np.ndarray, step: int = 1) -> float:
    """Return the fraction of pixels of which some channel differs by more than `step` of 255."""
    difference = np.abs(a.astype(np.int16) - b.astype(np.int16))
    return float((difference > step).any(axis=-1).mean())
