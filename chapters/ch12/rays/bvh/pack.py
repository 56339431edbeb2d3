"""From meshes and instances to the three buffers that the traversal reads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import model
from .build import Tree, build, build_all, cut

Floats = NDArray[np.float32]
Integers = NDArray[np.int64]
Mesh = tuple[Floats, NDArray[np.uint32]]
"""Positions (V, 3), and (3 T,) or (T, 3) indices."""

BATCH = 1 << 17
"""About how many triangles are built together: arrays of more leave a processor's cache, and take much memory."""


@dataclass
class MeshTree:
    """The hierarchy of one mesh: its nodes and triangles, numbered from 0, and what was left out.

    `box` (2, 3) is around all triangles, inside out without any. `levels` are those of `Tree`. `left_out` counts
    triangles that no ray may hit.
    """

    nodes: np.ndarray
    triangles: np.ndarray
    box: Floats
    levels: list[int]
    left_out: int


@dataclass
class Buffers:
    """What is uploaded: `nodes` (those of the upper level come last), `triangles`, and `instances`, words with a head.

    `roots` (M,) is the node at which each mesh begins, `firsts` (M,) its first triangle. `slots` tell the kernels that
    write records which instance each is. `levels` are where the levels of the upper part begin among all nodes.
    """

    nodes: np.ndarray
    triangles: np.ndarray
    instances: NDArray[np.uint32]
    roots: Integers
    firsts: Integers
    slots: np.ndarray
    levels: list[int]
    left_out: int


def nodes_of(trees: Sequence[Tree]) -> list[np.ndarray]:
    """Return the records of each tree's inner nodes, numbered from 0, with leaves of ranges of its order."""
    children, low, high, first, count = (
        np.concatenate([getattr(tree, name) for tree in trees])
        for name in ("children", "low", "high", "first", "count")
    )
    inner, leaves = [len(tree.children) for tree in trees], [len(tree.first) for tree in trees]
    before = np.repeat(np.cumsum(leaves) - leaves, inner)  # leaves of earlier trees, of each node
    nodes = np.zeros(len(children), model.NODE)
    for side in range(2):
        child = children[:, side]
        leaf = np.flatnonzero(child < 0)
        code = child.astype(np.uint32)
        which = ~child[leaf] + before[leaf]
        full = model.leaf_code(first[which], np.maximum(count[which], 1))
        code[leaf] = np.where(count[which] > 0, full, np.uint32(model.NO_CHILD))
        nodes[f"child{side}"], nodes[f"low{side}"], nodes[f"high{side}"] = code, low[:, side], high[:, side]
    return [part if len(part) else nothing() for part in cut(nodes, inner)]


def nothing() -> np.ndarray:
    """Return the node of a tree without primitives."""
    node = np.zeros(1, model.NODE)
    for side in range(2):
        node[f"child{side}"] = model.NO_CHILD
        node[f"low{side}"], node[f"high{side}"] = np.inf, -np.inf
    return node


def moved(nodes: np.ndarray, by_nodes: ArrayLike, by_leaves: ArrayLike) -> np.ndarray:
    """Return nodes whose codes count from other beginnings, the same for all or one for each."""
    shifted = nodes.copy()
    for side in range(2):
        code = nodes[f"child{side}"]
        by = np.where(code >= model.LEAF, by_leaves, by_nodes).astype(np.uint32)
        shifted[f"child{side}"] = np.where(code == model.NO_CHILD, code, code + by)
    return shifted


def mesh_tree(
    positions: Floats,
    indices: NDArray[np.uint32],
    *,
    mesh: int = 0,
    deforming: bool = False,
    largest: int = model.LEAF_LARGEST,
) -> MeshTree:
    """Return the hierarchy over the triangles of a mesh, (V, 3) positions and (3 T,) indices; `mesh` is its number.

    Triangles with a corner that is not finite, or beyond 1e18, and those without area are left out: no ray may hit
    them.
    A deforming mesh keeps them, since they may get an area: they lie at 0 in a leaf's list, whose box is without
    them. It also has room for as many nodes as a rebuild may need (fast.py): those behind the tree's own have no
    children.
    """
    return _together({mesh: (positions, indices)}, {mesh} if deforming else (), largest)[0]


def mesh_trees(meshes: Sequence[Mesh], deforming: Collection[int] = ()) -> list[MeshTree]:
    """Return what `mesh_tree` makes of each mesh, in much less time if many are small; some numbers are `deforming`."""
    ends = np.cumsum([np.size(indices) // 3 for _, indices in meshes])
    trees = []
    for _, batch in groupby(range(len(meshes)), lambda mesh: ends[mesh] // BATCH):
        trees += _together({mesh: meshes[mesh] for mesh in batch}, deforming)
    return trees


def _together(
    meshes: Mapping[int, Mesh], deforming: Collection[int], largest: int = model.LEAF_LARGEST
) -> list[MeshTree]:
    """Return the trees of some meshes, by their numbers, all built at once."""
    parts = [
        np.asarray(positions, np.float32)[np.asarray(indices).reshape(-1, 3)]
        for positions, indices in meshes.values()
    ]
    numbers, deforms = np.array(list(meshes)), np.isin(list(meshes), list(deforming))
    corners, sizes = np.concatenate(parts), [len(part) for part in parts]
    mesh_of = np.repeat(np.arange(len(meshes)), sizes)
    primitives = np.concatenate([np.arange(size) for size in sizes])
    sound = usable(corners)
    kept = np.flatnonzero(sound | deforms[mesh_of])
    used = np.where(sound[kept, None, None], corners[kept], np.float32(0.0))
    counts = np.bincount(mesh_of[kept], minlength=len(meshes))
    trees = build_all(used.min(axis=1), used.max(axis=1), counts, largest)
    order = np.concatenate([tree.order for tree in trees]) + np.repeat(np.cumsum(counts) - counts, counts)
    listed, triangles = kept[order], np.zeros(len(kept), model.TRIANGLE)
    for corner, name in enumerate("abc"):
        triangles[name] = used[order, corner]
    triangles["primitive"], triangles["mesh"] = primitives[listed], numbers[mesh_of[listed]]
    triangles["flags"] = np.where(sound[listed], 0, model.UNUSABLE)
    left_out = np.bincount(mesh_of[~sound], minlength=len(meshes)).tolist()
    nodes, own = nodes_of(trees), cut(triangles, counts)
    for mesh in np.flatnonzero(deforms).tolist():
        if left_out[mesh]:
            refit(nodes[mesh], trees[mesh].levels, own[mesh])
        room = max(int(counts[mesh]) - 1 - len(nodes[mesh]), 0)
        nodes[mesh] = np.concatenate([nodes[mesh], np.repeat(nothing(), room)])
    roots = np.concatenate([part[:1] for part in nodes])
    boxes = np.stack(
        [np.minimum(roots["low0"], roots["low1"]), np.maximum(roots["high0"], roots["high1"])], axis=1
    )
    levels = [tree.levels for tree in trees]
    return [MeshTree(*parts) for parts in zip(nodes, own, boxes, levels, left_out, strict=True)]


def refit(nodes: np.ndarray, levels: list[int], triangles: np.ndarray | None = None) -> None:
    """Enlarge or shrink the boxes of nodes numbered from 0, in place, from the last level to the root.

    Boxes of leaves come from `triangles`; without any, leaves keep theirs. The kernel does the same (refit.comp).
    """
    if triangles is not None and len(triangles):
        corners = np.stack([triangles[name] for name in "abc"], axis=1)
        lows, highs = corners.min(axis=1), corners.max(axis=1)
        unusable = (triangles["flags"] & model.UNUSABLE) != 0
        lows[unusable], highs[unusable] = np.inf, -np.inf
    for begin, end in zip(levels[-2::-1], levels[:0:-1], strict=True):
        level = nodes[begin:end]
        for side in "01":
            code = level[f"child{side}"]
            inner = np.flatnonzero(code < model.LEAF)
            below = nodes[code[inner]]
            level[f"low{side}"][inner] = np.minimum(below["low0"], below["low1"])
            level[f"high{side}"][inner] = np.maximum(below["high0"], below["high1"])
            leaf = np.flatnonzero((code >= model.LEAF) & (code != model.NO_CHILD))
            if triangles is None or not len(leaf):
                continue
            first = code[leaf] & np.uint32((1 << model.COUNT_SHIFT) - 1)
            last = first + (code[leaf] >> np.uint32(model.COUNT_SHIFT) & np.uint32(3))
            each = np.minimum(first[:, None] + np.arange(model.LEAF_LARGEST), last[:, None]).astype(np.int64)
            level[f"low{side}"][leaf] = lows[each].min(axis=1)
            level[f"high{side}"][leaf] = highs[each].max(axis=1)


def usable(corners: Floats) -> NDArray[np.bool_]:
    """Return which triangles (T, 3, 3) are finite and have an area, in float64."""
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


def inverses(world_from_object: NDArray[np.float64]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the rows of the records of matrices (I, 3, 4), and which of these have an inverse that is finite."""
    finite = np.asarray(np.isfinite(world_from_object).all(axis=(1, 2)))
    linear = np.where(finite[:, None, None], world_from_object[:, :, :3], 0.0)
    sound = finite & (np.linalg.det(linear) != 0)
    rows = np.zeros((len(linear), 3, 4), np.float32)
    with np.errstate(over="ignore"):
        rows[:, :, :3] = np.linalg.inv(np.where(sound[:, None, None], linear, np.eye(3)))
        rows[:, :, 3] = np.where(finite[:, None], world_from_object[:, :, 3], 0.0)
    return rows, sound & np.isfinite(rows).all(axis=(1, 2))


def buffers(
    meshes: Sequence[MeshTree],
    world_from_object: ArrayLike,
    mesh_of: ArrayLike,
    mask: ArrayLike = 1,
    ids: ArrayLike | None = None,
    flags: ArrayLike = 0,
) -> Buffers:
    """Return all buffers of a scene of instances, given by matrices (I, 3 or 4, 4), meshes (I,), masks, ids and flags.

    The box of an instance that no ray can meet is inside out: its mask is 0, its mesh is empty, or its matrix is
    singular or not finite. Raises ValueError for more than 2^24 instances or 2^29 triangles.
    """
    matrices = np.asarray(world_from_object, np.float64)
    matrices = matrices.reshape(-1, matrices.shape[-2], 4)[:, :3]
    mesh_of, count = np.asarray(mesh_of, np.int64), len(matrices)
    check_sizes(count, sum(len(mesh.triangles) for mesh in meshes))
    sizes = [len(mesh.nodes) for mesh in meshes], [len(mesh.triangles) for mesh in meshes]
    roots, firsts = (np.concatenate([[0], np.cumsum(part)]).astype(np.int64) for part in sizes)
    boxes = np.array([mesh.box for mesh in meshes], np.float32).reshape(-1, 2, 3)[mesh_of]
    rows, sound = inverses(matrices)
    masks = np.broadcast_to(np.asarray(mask, np.uint32), count)
    seen = sound & (boxes[:, 0] <= boxes[:, 1]).all(axis=1)
    placed = np.zeros((count, 2, 3), np.float32)
    placed[seen] = world_boxes(matrices[seen], boxes[seen])
    tree = build(placed[:, 0], placed[:, 1], 1)
    order, top = tree.order, nodes_of([tree])[0]
    records = np.zeros(count, model.INSTANCE)
    records["rows"], records["root"] = rows[order], roots[mesh_of[order]]
    records["id"] = order if ids is None else np.asarray(ids)[order]
    records["flags"] = np.broadcast_to(np.asarray(flags, np.uint32), count)[order]
    records["mask"] = np.where(seen, masks, 0)[order]
    slots = np.zeros(count, model.SLOT)
    slots["instance"], slots["mask"], slots["flags"] = records["id"], masks[order], records["flags"]
    for side in range(2):
        code = top[f"child{side}"]
        leaf = np.flatnonzero((code >= model.LEAF) & (code != model.NO_CHILD))
        record = code[leaf] & np.uint32((1 << model.COUNT_SHIFT) - 1)
        slots["box"][record] = 2 * (leaf + roots[-1]) + side
        hidden = leaf[records["mask"][record] == 0]
        top[f"low{side}"][hidden], top[f"high{side}"][hidden] = np.inf, -np.inf
    refit(top, tree.levels)
    head = np.zeros(1, model.HEAD)
    head["root"], head["count"] = roots[-1], count
    below = [mesh.nodes for mesh in meshes]
    by = (np.repeat(part, [*sizes[0], len(top)]) for part in (roots, [*firsts[:-1], 0]))
    return Buffers(
        moved(np.concatenate([*below, top]), *by),
        np.concatenate(
            [*(mesh.triangles for mesh in meshes), np.zeros(int(firsts[-1] == 0), model.TRIANGLE)]
        ),
        np.concatenate([head.view(np.uint32), records.view(np.uint32)]),
        roots[:-1],
        firsts[:-1],
        slots,
        [int(roots[-1]) + level for level in tree.levels],
        sum(mesh.left_out for mesh in meshes),
    )


def check_sizes(instances: int, triangles: int) -> None:
    """Raise ValueError if there are more than the records can count."""
    if instances > model.INSTANCES_LARGEST:
        raise ValueError(f"a scene of {instances} instances is too large for rays: they know 2^24 at most")
    if triangles > model.TRIANGLES_LARGEST:
        raise ValueError(f"meshes of {triangles} triangles are too large for rays: they know 2^29 at most")


def refit_lists(meshes: Sequence[tuple[int, list[int]]]) -> list[NDArray[np.uint32]]:
    """Return lists of nodes to refit one after the other, deepest level first, of hierarchies (first node, levels).

    Levels that are equally deep share a list: the longest path, not the number of meshes, says how many dispatches
    follow.
    """
    depth = max((len(levels) - 1 for _, levels in meshes), default=0)
    return [
        np.concatenate([
            np.arange(first + levels[at], first + levels[at + 1], dtype=np.uint32)
            for first, levels in meshes
            if at < len(levels) - 1
        ])
        for at in range(depth - 1, -1, -1)
    ]  # fmt: skip
