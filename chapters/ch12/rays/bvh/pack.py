"""From meshes and instances to the three buffers that the traversal reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import model
from .build import Tree, build

Floats = NDArray[np.float32]


@dataclass
class MeshTree:
    """The hierarchy of one mesh: its nodes and triangles, numbered from 0, and what was left out.

    `box` (2, 3) is around all triangles, zeros without any. `levels` are those of `Tree`.
    """

    nodes: np.ndarray
    triangles: np.ndarray
    box: Floats
    levels: list[int]
    left_out: int


@dataclass
class Buffers:
    """What is uploaded: `nodes` (those of the upper level come last), `triangles`, and `instances` with a head.

    `roots` (M,) is the node at which each mesh begins. `left_out` counts triangles that are not finite or without area.
    """

    nodes: np.ndarray
    triangles: np.ndarray
    instances: np.ndarray
    roots: NDArray[np.int64]
    left_out: int


def nodes_of(tree: Tree) -> np.ndarray:
    """Return the records of a tree's inner nodes, numbered from 0, with leaves of ranges of its order."""
    nodes = np.zeros(len(tree.children), model.NODE)
    for side in range(2):
        child = tree.children[:, side]
        leaf = np.where(child < 0, ~child, 0)
        count = tree.count[leaf] if len(tree.count) else leaf
        first = tree.first[leaf] if len(tree.first) else leaf
        code = np.where(child < 0, model.leaf_code(first, np.maximum(count, 1)), child.astype(np.uint32))
        nodes[f"child{side}"] = np.where((child < 0) & (count == 0), np.uint32(model.NO_CHILD), code)
        nodes[f"low{side}"], nodes[f"high{side}"] = tree.low[:, side], tree.high[:, side]
    return nodes if len(nodes) else nothing()


def nothing() -> np.ndarray:
    """Return the node of a tree without primitives."""
    node = np.zeros(1, model.NODE)
    for side in range(2):
        node[f"child{side}"] = model.NO_CHILD
        node[f"low{side}"], node[f"high{side}"] = np.inf, -np.inf
    return node


def moved(nodes: np.ndarray, by_nodes: int, by_leaves: int) -> np.ndarray:
    """Return nodes whose codes count from other beginnings."""
    shifted = nodes.copy()
    for side in range(2):
        code = nodes[f"child{side}"]
        by = np.where(code >= model.LEAF, np.uint32(by_leaves), np.uint32(by_nodes))
        shifted[f"child{side}"] = np.where(code == model.NO_CHILD, code, code + by)
    return shifted


def mesh_tree(positions: Floats, indices: NDArray[np.uint32], largest: int = model.LEAF_LARGEST) -> MeshTree:
    """Return the hierarchy over the triangles of a mesh, (V, 3) positions and (3 T,) indices.

    Triangles with a corner that is not finite, or beyond 1e18, and those without area are left out: no ray may hit them.
    """
    corners = np.asarray(positions, np.float32)[np.asarray(indices).reshape(-1, 3)]
    kept = np.flatnonzero(usable(corners))
    used = corners[kept]
    tree = build(used.min(axis=1), used.max(axis=1), largest)
    triangles = np.zeros(len(kept), model.TRIANGLE)
    for corner, name in enumerate("abc"):
        triangles[name] = used[tree.order, corner]
    triangles["primitive"] = kept[tree.order]
    box = np.zeros((2, 3), np.float32)
    if len(kept):
        box[:] = used.min(axis=(0, 1)), used.max(axis=(0, 1))
    return MeshTree(nodes_of(tree), triangles, box, tree.levels, len(corners) - len(kept))


def usable(corners: Floats) -> NDArray[np.bool_]:
    """Return which triangles (T, 3, 3) are finite and have an area, in float64: the difference of floats is exact there."""
    exact = corners.astype(np.float64)
    finite = (np.abs(exact) <= 1e18).all(axis=(1, 2))
    exact[~finite] = 0.0
    normal = np.cross(exact[:, 1] - exact[:, 0], exact[:, 2] - exact[:, 0])
    usable: NDArray[np.bool_] = (normal != 0.0).any(axis=1)
    return usable


def world_boxes(world_from_object: NDArray[np.float64], boxes: Floats) -> Floats:
    """Return (I, 2, 3) boxes in the world around boxes (I, 2, 3) in object space (Arvo 1990), rounded outwards."""
    linear, boxes = world_from_object[:, :3, :3], boxes.astype(np.float64)
    middle = np.einsum("nij,nj->ni", linear, boxes.mean(axis=1)) + world_from_object[:, :3, 3]
    half = np.einsum("nij,nj->ni", np.abs(linear), (boxes[:, 1] - boxes[:, 0]) / 2)
    low, high = (middle - half).astype(np.float32), (middle + half).astype(np.float32)
    return np.stack([np.nextafter(low, np.float32(-np.inf)), np.nextafter(high, np.float32(np.inf))], axis=1)


def buffers(
    meshes: Sequence[MeshTree],
    world_from_object: ArrayLike,
    mesh_of: ArrayLike,
    mask: ArrayLike = 1,
    ids: ArrayLike | None = None,
    flags: ArrayLike = 0,
) -> Buffers:
    """Return all buffers of a scene of instances, given by matrices (I, 3 or 4, 4), meshes (I,), masks, ids and flags.

    Instances that no ray can meet are left out of the upper level: those whose mask is 0, whose mesh is empty, and whose
    matrix is singular or not finite. Raises ValueError for more than 2^24 instances or 2^29 triangles.
    """
    matrices = np.asarray(world_from_object, np.float64).reshape(-1, np.shape(world_from_object)[-2], 4)[:, :3]
    mesh_of = np.asarray(mesh_of, np.int64)
    count = len(matrices)
    if count > model.INSTANCES_LARGEST:
        raise ValueError(f"a scene of {count} instances is too large for rays: they know 2^24 at most")
    sizes = [len(mesh.nodes) for mesh in meshes], [len(mesh.triangles) for mesh in meshes]
    roots, firsts = (np.concatenate([[0], np.cumsum(part)]).astype(np.int64) for part in sizes)
    if firsts[-1] > model.TRIANGLES_LARGEST:
        raise ValueError(f"meshes of {firsts[-1]} triangles are too large for rays: they know 2^29 at most")
    below = [moved(mesh.nodes, int(root), int(first)) for mesh, root, first in zip(meshes, roots, firsts, strict=False)]
    boxes = np.array([mesh.box for mesh in meshes], np.float32).reshape(-1, 2, 3)

    records = np.zeros(count, model.INSTANCE)
    linear = matrices[:, :, :3]
    finite = np.isfinite(matrices).all(axis=(1, 2))
    sound = finite & (np.linalg.det(np.where(finite[:, None, None], linear, 0.0)) != 0)
    inverse = np.linalg.inv(np.where(sound[:, None, None], linear, np.eye(3)))
    records["object_from_world"][:, :, :3] = inverse
    records["object_from_world"][:, :, 3] = -np.einsum("nij,nj->ni", inverse, np.where(sound[:, None], matrices[:, :, 3], 0))
    records["root"], records["mask"], records["flags"] = roots[mesh_of], mask, flags
    records["id"] = np.arange(count) if ids is None else ids
    own = boxes[mesh_of]
    records["centre"][:, :3], records["extent"][:, :3] = own.mean(axis=1), own[:, 1] - own.mean(axis=1)
    full = np.array([len(mesh.triangles) > 0 for mesh in meshes], bool)[mesh_of]
    kept = np.flatnonzero(sound & full & (records["mask"] != 0))
    placed = world_boxes(matrices[kept], own[kept])
    tree = build(placed[:, 0], placed[:, 1], 1)
    head = np.zeros(1, HEAD)
    head["root"] = roots[-1]
    if len(kept):
        middle = placed.mean(axis=(0, 1))
        low, high = placed[:, 0].min(axis=0), placed[:, 1].max(axis=0)
        middle = (low + high) / 2
        head["centre"][0, :3], head["extent"][0, :3] = middle, np.maximum(high - middle, middle - low)
    top = moved(nodes_of(tree), int(roots[-1]), 0)
    instances = np.concatenate([head.view(np.uint32), records[kept[tree.order]].view(np.uint32)])
    triangles = [mesh.triangles for mesh in meshes] if firsts[-1] else [np.zeros(1, model.TRIANGLE)]
    return Buffers(
        np.concatenate([*below, top]),
        np.concatenate(triangles),
        instances,
        roots[:-1],
        sum(mesh.left_out for mesh in meshes),
    )


HEAD = np.dtype([("root", np.uint32, 4), ("centre", np.float32, 4), ("extent", np.float32, 4)])
"""What the buffer of instances begins with: the node of the upper level, and the box around it."""
