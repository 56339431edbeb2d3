"""What the studies of meshlets share: a field of many instances of four meshes, and the kernels that cull its meshlets.

A *unit* is a meshlet of an instance. Units are numbered by instance, and within one in the order of the meshlets, which
is also the order of their triangles in the list of indices. All that culling leaves keeps this order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from common.errors import UnsupportedError
from common.numerics.transforms import compose, rotation
from common.scene import MESH_DTYPE, Material
from common.scene.primitive import scene_of
from common.view.camera import Orthographic, View

from ...meshlets.build import build_meshlets
from .shapes import all_meshes

INSTANCE = np.dtype(
    [
        ("world_from_object", np.float32, (3, 4)),
        ("first_meshlet", np.uint32),
        ("meshlets", np.uint32),
        ("first_unit", np.uint32),
        ("mesh", np.uint32),
    ]
)
"""64 bytes, `Instance` of field.glsl."""

SPREAD = 4.0
"""Radius of the disc on which the instances are, metres. The default camera stands above its middle."""

MOST_INSTANCES = 65_535
"""A kernel has one work group for each instance, and this is the most along an axis."""

UNIFORM_BYTES = 3 * 64 + 2 * 16
FOLDER = "studies/meshlet_field"


@dataclass(frozen=True, eq=False)
class Field:
    """The arrays of a field.

    `vertices` (2 V, 3) float32 are the positions of all meshes, then their normals. `indices` (I,) uint32 are numbers
    of vertices. `meshlets` (K,) MESHLET have a `first_index` relative to the whole list, and `words` are their data.
    `instances` (N,) INSTANCE. `units` is the number of meshlets of all instances, `most_indices` that of their indices.
    """

    vertices: np.ndarray
    indices: np.ndarray
    meshlets: np.ndarray
    words: np.ndarray
    instances: np.ndarray
    units: int
    most_indices: int


@lru_cache(4)
def field_of(count: int, max_vertices: int = 64, max_triangles: int = 124) -> Field:
    """Return a field of `count` instances, whose meshlets have at most so many vertices and triangles."""
    shapes = all_meshes()
    meshes = np.zeros(len(shapes), MESH_DTYPE)
    meshes["index_count"] = [shape.indices.size for shape in shapes]
    meshes["first_index"] = np.cumsum(meshes["index_count"]) - meshes["index_count"]
    sizes = np.array([len(shape.positions) for shape in shapes])
    meshes["vertex_count"] = sizes.sum()  # all meshes share one list of vertices, which begins at 0
    starts = np.cumsum(sizes) - sizes
    positions = np.concatenate([shape.positions for shape in shapes])
    normals = np.concatenate([shape.normals for shape in shapes])
    indices = np.concatenate(
        [shape.indices.ravel() + start for shape, start in zip(shapes, starts, strict=True)]
    )
    scene = scene_of("field", positions, normals, positions[:, :2], indices, Material(), [])
    scene = replace(scene, meshes=meshes, mesh_names=["field"] * len(meshes))
    built = build_meshlets(scene, max_vertices, max_triangles)
    records = built.records.copy()
    records["first_index"] += meshes["first_index"][records["mesh"]]

    instances = np.zeros(count, INSTANCE)
    instances["mesh"] = mesh = np.arange(count) % len(meshes)
    instances["world_from_object"] = _placed(count)
    instances["first_meshlet"], instances["meshlets"] = built.ranges[mesh].T
    ends = np.cumsum(instances["meshlets"], dtype=np.int64)
    instances["first_unit"] = ends - instances["meshlets"]
    vertices = np.concatenate([scene.positions, scene.normals])
    most = int(meshes["index_count"][mesh].sum(dtype=np.int64))
    return Field(vertices, built.indices, records, built.words, instances, int(ends[-1]), most)


def _placed(count: int) -> np.ndarray:
    """Return (N, 3, 4) rows of world_from_object: a spiral over the disc, each object turned and scaled by lot."""
    random, number = np.random.default_rng(6), np.arange(count)
    away, turn = SPREAD * np.sqrt((number + 0.5) / count), np.pi * (3.0 - np.sqrt(5.0)) * number
    places = np.stack([away * np.cos(turn), np.zeros(count), away * np.sin(turn)], axis=-1)
    turns = random.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    size = min(0.85 * SPREAD / np.sqrt(count), 0.5) * random.uniform(0.7, 1.0, (count, 1))
    return compose(places, turns, np.repeat(size, 3, axis=1))[:, :3]


def uniforms(view: View, size: tuple[int, int], turned: float) -> np.ndarray:
    """Return `View` of field.glsl, (56,) float32.

    The camera of the picture is `turned` around the y axis by so many degrees; culling keeps to the view itself.
    """
    projection = view.clip_from_view(size[0] / size[1])
    drawn = replace(
        view, world_from_view=rotation((0.0, 1.0, 0.0), np.radians(turned)) @ view.world_from_view
    )
    matrices = np.stack([view.view_from_world().T, projection.T, drawn.view_from_world().T])
    flat = isinstance(view.projection, Orthographic)
    eye = -view.world_from_view[:3, 2] if flat else view.eye
    return np.concatenate([matrices.ravel(), eye, [flat], size, [0.0, 0.0]]).astype(np.float32)


def defines(culling: bool, group: int, way: int = 0) -> tuple[tuple[str, int], ...]:
    """Return the macros of the kernels: `group` invocations of a work group, and a `way` of field.glsl."""
    return ("CULLING", int(culling)), ("GROUP", group), ("WAY", way)


def check_bytes(size: int, what: str, limit: int) -> None:
    """Raise UnsupportedError for a buffer that is larger than the device's storage buffers."""
    if size > limit:
        raise UnsupportedError(
            f"The {what} of this field take {size / 2**20:.0f} MiB, and storage buffers of this device have at most "
            f"{limit / 2**20:.0f}: set fewer instances."
        )
