"""Builds a bounding volume hierarchy by the binned surface area heuristic, over all nodes of a level at once.

Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies": primitives are counted in bins along each
axis, and a node is split between the two bins where area times count of both sides is least. Here every array operation
works on all primitives and all nodes of a level, so that numpy's cost for a call does not grow with nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .model import COUNT_SHIFT, DEPTH_UPPER, LEAF, LEAF_LARGEST, NO_CHILD

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Integers = NDArray[np.int64]

BINS = 16
AXES = (0, 1, 2)


@dataclass
class Tree:
    """A hierarchy of two children each, inner nodes level by level from the root.

    `order` (N,) lists primitives as leaves use them. Children (M, 2) are numbers of inner nodes, or ~leaf; leaves have
    `first` and `count`, a range of `order`. Boxes `low` and `high` (M, 2, 3) are those of the children. `levels`
    has the first node of each level and the number of nodes last. Without primitives there is no node. Where one
    leaf has all primitives, the root has it as its first child and a leaf of none as its second.
    """

    order: Integers
    children: Integers
    low: Floats
    high: Floats
    first: Integers
    count: Integers
    levels: list[int]

    @property
    def depth(self) -> int:
        """How many inner nodes stand above one another at most."""
        return len(self.levels) - 1


def _area(low: Floats, high: Floats) -> Doubles:
    """Return half the surface of (3, ...) boxes; 0 of boxes inside out, such as those of no primitive."""
    x, y, z = np.maximum(high - low, 0.0).astype(np.float64)  # squares of large sizes leave float32
    area: Doubles = x * y + y * z + z * x
    return area


def _inside_out(count: int) -> tuple[Floats, Floats]:
    """Return the corners (3, count) of boxes around nothing."""
    return np.full((3, count), np.inf, np.float32), np.full((3, count), -np.inf, np.float32)


def _sweep(low: Floats, high: Floats, count: Integers) -> Doubles:
    """Return (B - 1, K) costs of splits behind each bin, from boxes (3, B, K) and counts (B, K) of bins."""
    bins = len(count)
    cost = np.empty((bins - 1, count.shape[1]))
    before = np.cumsum(count, axis=0)
    all_ = before[-1]
    low_now, high_now = low[:, 0].copy(), high[:, 0].copy()
    for at in range(bins - 1):
        cost[at] = _area(low_now, high_now) * before[at]
        np.minimum(low_now, low[:, at + 1], out=low_now)
        np.maximum(high_now, high[:, at + 1], out=high_now)
    low_now, high_now = low[:, -1].copy(), high[:, -1].copy()
    for at in range(bins - 2, -1, -1):
        cost[at] += _area(low_now, high_now) * (all_ - before[at])
        np.minimum(low_now, low[:, at], out=low_now)
        np.maximum(high_now, high[:, at], out=high_now)
    cost[(before[:-1] == 0) | (before[:-1] == all_)] = np.inf
    return cost


def build(low: Floats, high: Floats, largest: int = LEAF_LARGEST, bins: int = BINS) -> Tree:
    """Return the tree over (N, 3) boxes, all finite, with leaves of at most `largest` primitives.

    Where all centres of a node are in one bin of every axis, and where the level leaves no room for uneven splits below
    DEPTH_UPPER, a node is split in the middle of its list. The result depends on nothing but the boxes.
    """
    return build_all(low, high, [len(low)], largest, bins)[0]


def build_all(
    low: Floats, high: Floats, counts: ArrayLike, largest: int = LEAF_LARGEST, bins: int = BINS
) -> list[Tree]:
    """Return the trees over the first counts[0] of (N, 3) boxes, over the next counts[1], and so on.

    Each is the tree that `build` makes of its boxes alone. A level has the nodes of all trees, those of a tree side by
    side: all trees together take as many array operations as the deepest of them.
    """
    sizes = np.asarray(counts, np.int64)
    begins = np.cumsum(sizes) - sizes
    boxes = np.concatenate([low.T, high.T]).astype(np.float32)  # (6, N)
    centres = boxes[:3] * np.float32(0.5) + boxes[3:] * np.float32(0.5)
    prims = np.arange(len(low))
    order = prims.copy()
    # Of each node of this level: its tree, where its range of the order begins, and how many primitives it has.
    tree = np.flatnonzero(sizes)
    first, count = begins[tree], sizes[tree]
    # Of each tree: how many inner nodes and leaves have got their numbers.
    inner, leaf = np.bincount(tree, minlength=len(sizes)), np.zeros(len(sizes), np.int64)
    levels = [np.zeros_like(inner)]
    none = np.zeros(0, np.int64)
    leaves, nodes = [(none, none, none)], [(none, none.reshape(0, 2), *np.zeros((2, 0, 2, 3), np.float32))]
    while len(tree):
        begin = np.cumsum(count) - count  # in the arrays of this level
        side = _sides(boxes, centres, tree, begin, count, bins, largest, len(levels))
        side &= np.repeat(count > largest, count)  # a root with primitives for one leaf has no other
        left, source = _partition(side, begin)
        prims, boxes, centres = prims[source], _rows(boxes, source), _rows(centres, source)

        owner = np.repeat(tree, 2)
        both = np.stack([left, count - left], axis=1).reshape(-1)
        firsts = np.stack([first, first + left], axis=1).reshape(-1)
        starts = np.cumsum(both) - both
        some = both > 0
        child_low, child_high = _inside_out(len(both))
        child_low[:, some] = np.minimum.reduceat(boxes[:3], starts[some], axis=1)
        child_high[:, some] = np.maximum.reduceat(boxes[3:], starts[some], axis=1)
        is_leaf = both <= largest
        codes = np.empty(len(both), np.int64)
        levels.append(inner.copy())
        codes[is_leaf] = ~_number(owner[is_leaf], leaf)
        codes[~is_leaf] = _number(owner[~is_leaf], inner)
        nodes.append(
            (tree, codes.reshape(-1, 2), *(it.T.reshape(-1, 2, 3) for it in (child_low, child_high)))
        )
        leaves.append((owner[is_leaf], firsts[is_leaf], both[is_leaf]))

        if is_leaf.any():
            done = np.repeat(is_leaf, both)
            target = np.repeat(firsts - starts, both) + np.arange(len(prims))
            order[target[done]] = prims[done]
            rest = np.flatnonzero(~done)
            prims, boxes, centres = prims[rest], _rows(boxes, rest), _rows(centres, rest)
        tree, first, count = owner[~is_leaf], firsts[~is_leaf], both[~is_leaf]
    # Nodes and leaves stand by levels; sorted by trees, which keeps levels in order, they are cut apart.
    node_tree, *boxed = (np.concatenate(parts) for parts in zip(*nodes, strict=True))
    leaf_tree, leaf_first, leaf_count = (np.concatenate(parts) for parts in zip(*leaves, strict=True))
    by_node, by_leaf = (np.argsort(it, kind="stable") for it in (node_tree, leaf_tree))
    columns = (
        cut(order - np.repeat(begins, sizes), sizes),
        *(cut(part[by_node], inner) for part in boxed),
        cut((leaf_first - begins[leaf_tree])[by_leaf], leaf),
        cut(leaf_count[by_leaf], leaf),
        [np.unique(level).tolist() for level in np.stack(levels, axis=1)],
    )
    return [Tree(*parts) for parts in zip(*columns, strict=True)]


def cut(rows: np.ndarray, sizes: ArrayLike) -> list[np.ndarray]:
    """Return the first sizes[0] rows, the next sizes[1], and so on."""
    ends = np.cumsum(sizes).tolist()
    return [rows[end - size : end] for size, end in zip(np.asarray(sizes).tolist(), ends, strict=True)]


def _number(owner: Integers, totals: Integers) -> Integers:
    """Return numbers within each tree of nodes of trees `owner`, sorted, from `totals` on, to which they are added."""
    sizes = np.bincount(owner, minlength=len(totals))
    numbers: Integers = np.arange(len(owner)) + (totals - np.cumsum(sizes) + sizes)[owner]
    totals += sizes
    return numbers


def _rows(array: Floats, which: Integers) -> Floats:
    """Return `array[:, which]`, row by row, which numpy does faster."""
    rows = np.empty((len(array), len(which)), array.dtype)
    for row, values in zip(rows, array, strict=True):
        np.take(values, which, out=row, mode="clip")
    return rows


def _partition(side: NDArray[np.bool_], begin: Integers) -> tuple[Integers, Integers]:
    """Return how many of each node's range go to the left, and the list (P,) that puts them first, stably."""
    to_left, to_right = np.flatnonzero(~side), np.flatnonzero(side)
    right = np.add.reduceat(side, begin, dtype=np.int64)
    left = np.diff(begin, append=len(side)) - right
    source = np.empty(len(side), np.int64)
    source[np.arange(len(to_left)) + np.repeat(np.cumsum(right) - right, left)] = to_left
    source[np.arange(len(to_right)) + np.repeat(np.cumsum(left), right)] = to_right
    return left, source


def _sides(
    boxes: Floats,
    centres: Floats,
    tree: Integers,
    begin: Integers,
    count: Integers,
    bins: int,
    largest: int,
    level: int,
) -> NDArray[np.bool_]:
    """Return which primitives (P,) of a level go to the right child of their node; `tree` (K,) is that of each node."""
    nodes, total = len(count), len(centres[0])
    # Few primitives need few bins: at the last levels a tree has more nodes than this leaves primitives to each.
    many = np.bincount(tree, count) > 4 * bins * np.bincount(tree)
    own_bins = np.where(many, bins, max(bins // 2, 4))[tree]
    bins = own_bins.max()
    lows = np.minimum.reduceat(centres, begin, axis=1)
    sizes = np.maximum.reduceat(centres, begin, axis=1) - lows
    with np.errstate(divide="ignore", over="ignore"):
        scales = np.where(sizes > 0, (own_bins * 0.999999).astype(np.float32) / sizes, np.float32(0.0))
    scales[~np.isfinite(scales)] = 0.0
    node = np.repeat(np.arange(nodes), count)
    row = len(AXES) * nodes  # a bin of all axes and nodes
    counts = np.zeros(bins * row, np.int64)
    low, high = _inside_out(bins * row)
    keys = []
    for axis in AXES:
        key = centres[axis] - np.repeat(lows[axis], count)
        key *= np.repeat(scales[axis], count)
        key = key.astype(np.int64)
        key *= row
        key += node
        key += axis * nodes
        keys.append(key)
        counts += np.bincount(key, minlength=bins * row)
        for part in range(3):
            np.minimum.at(low[part], key, boxes[part])
            np.maximum.at(high[part], key, boxes[3 + part])
    cost = _sweep(low.reshape(3, bins, row), high.reshape(3, bins, row), counts.reshape(bins, row))
    cost = cost.reshape(bins - 1, len(AXES), nodes).swapaxes(0, 1).reshape(-1, nodes)
    axis_of, bin_of = np.divmod(cost.argmin(axis=0), bins - 1)
    side = np.zeros(total, bool)
    for axis, key in enumerate(keys):
        # Keys of later bins are larger than all of this bin.
        side |= key >= np.repeat(np.where(axis_of == axis, bin_of + 1, bins) * row, count)
    # Halves reach leaves after this many levels; a node that has no more than those left must not be split unevenly.
    halvings = np.ceil(np.log2(np.maximum(count, largest) / largest))
    middle = np.isinf(cost.min(axis=0)) | (halvings >= DEPTH_UPPER - level)
    if middle.any():
        _split_in_the_middle(side, centres, begin, count, np.flatnonzero(middle))
    return side


def _split_in_the_middle(
    side: NDArray[np.bool_], centres: Floats, begin: Integers, count: Integers, which: Integers
) -> None:
    """Send the upper half of the nodes `which`, along the longest axis of their centres, to the right."""
    sizes = np.maximum.reduceat(centres, begin, axis=1) - np.minimum.reduceat(centres, begin, axis=1)
    longest = sizes.argmax(axis=0)
    lengths = count[which]
    owner = np.repeat(np.arange(len(which)), lengths)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    places = np.repeat(begin[which], lengths) + rank
    values = centres[longest[which][owner], places]
    sorted_ = np.lexsort((values, owner))
    side[places[sorted_]] = rank >= lengths[owner] // 2


def sah_cost(tree: Tree) -> float:
    """Return the expected cost of a ray that meets the root's box, in steps (Wald 2007, equation 2).

    A node and a triangle cost one each, times the share of the root's surface that their box has.
    """
    if not len(tree.children):
        return 0.0
    is_leaf = tree.children < 0
    counts = np.where(is_leaf, tree.count[np.where(is_leaf, ~tree.children, 0)], 1)
    return _cost(tree.low, tree.high, counts)


def cost(nodes: np.ndarray) -> float:
    """Return the same of records that may have been refitted: by how much it rose says when a rebuild is due."""
    codes = np.stack([nodes["child0"], nodes["child1"]], axis=1)
    counts = np.where(codes >= LEAF, (codes >> np.uint32(COUNT_SHIFT) & np.uint32(3)) + 1, 1)
    counts = np.where(codes == NO_CHILD, 0, counts)
    low, high = (np.stack([nodes[f"{end}0"], nodes[f"{end}1"]], axis=1) for end in ("low", "high"))
    return _cost(low, high, counts)


def _cost(low: Floats, high: Floats, counts: Integers) -> float:
    area = _area(np.moveaxis(low, -1, 0), np.moveaxis(high, -1, 0))
    root = float(_area(low[0].min(axis=0), high[0].max(axis=0)))
    return 1.0 + float((area * counts).sum()) / root if root > 0 else 0.0
