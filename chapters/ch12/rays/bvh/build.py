"""Builds a bounding volume hierarchy by the binned surface area heuristic, over all nodes of a level at once.

Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies": primitives are counted in bins along each
axis, and a node is split between the two bins where area times count of both sides is least. Here every array operation
works on all primitives and all nodes of a level, so that numpy's cost for a call does not grow with nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    total = len(low)
    boxes = np.concatenate([low.T, high.T]).astype(np.float32)  # (6, N)
    centres = boxes[:3] * np.float32(0.5) + boxes[3:] * np.float32(0.5)
    order = np.arange(total)
    leaves_first: list[Integers] = []
    leaves_count: list[Integers] = []
    children: list[Integers] = []
    child_low: list[Floats] = []
    child_high: list[Floats] = []
    levels, leaf_total = [0], 0
    if 0 < total <= largest:
        empty = np.full((1, 3), np.inf, np.float32)
        own = boxes.reshape(2, 3, total)
        return Tree(
            order,
            np.array([[~0, ~1]]),
            np.stack([own[0].min(axis=1)[None], empty], axis=1),
            np.stack([own[1].max(axis=1)[None], -empty], axis=1),
            np.array([0, 0]),
            np.array([total, 0]),
            [0, 1],
        )
    # Of each node of this level: where its range of the order begins, and how many primitives it has.
    first, count = np.array([0])[: min(total, 1)], np.array([total])[: min(total, 1)]
    prims = order
    while len(first):
        nodes = len(first)
        begin = np.cumsum(count) - count  # in the arrays of this level
        side = _sides(boxes, centres, begin, count, bins, largest, len(levels))
        left, source = _partition(side, begin)
        prims, boxes, centres = prims[source], _rows(boxes, source), _rows(centres, source)

        both = np.stack([left, count - left], axis=1).reshape(-1)
        starts = np.cumsum(both) - both
        child_low.append(np.minimum.reduceat(boxes[:3], starts, axis=1).T.reshape(nodes, 2, 3))
        child_high.append(np.maximum.reduceat(boxes[3:], starts, axis=1).T.reshape(nodes, 2, 3))
        firsts = np.stack([first, first + left], axis=1).reshape(-1)
        is_leaf = both <= largest
        codes = np.empty(2 * nodes, np.int64)
        codes[is_leaf] = ~(leaf_total + np.arange(is_leaf.sum()))
        levels.append(levels[-1] + nodes)
        codes[~is_leaf] = levels[-1] + np.arange((~is_leaf).sum())
        children.append(codes.reshape(nodes, 2))
        leaf_total += int(is_leaf.sum())
        leaves_first.append(firsts[is_leaf])
        leaves_count.append(both[is_leaf])

        if is_leaf.any():
            done = np.repeat(is_leaf, both)
            target = np.repeat(firsts - starts, both) + np.arange(len(prims))
            order[target[done]] = prims[done]
            rest = np.flatnonzero(~done)
            prims, boxes, centres = prims[rest], _rows(boxes, rest), _rows(centres, rest)
        first, count = firsts[~is_leaf], both[~is_leaf]
    if not children:
        none = np.zeros(0, np.int64)
        boxless = np.zeros((0, 2, 3), np.float32)
        return Tree(order, none.reshape(0, 2), boxless, boxless, none, none, [0])
    return Tree(
        order,
        np.concatenate(children),
        np.concatenate(child_low),
        np.concatenate(child_high),
        np.concatenate(leaves_first),
        np.concatenate(leaves_count),
        levels,
    )


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
    boxes: Floats, centres: Floats, begin: Integers, count: Integers, bins: int, largest: int, level: int
) -> NDArray[np.bool_]:
    """Return which primitives (P,) of a level go to the right child of their node."""
    nodes, total = len(count), len(centres[0])
    # Few primitives need few bins: at the last levels there are more nodes than this leaves primitives to each.
    bins = bins if total > 4 * bins * nodes else max(bins // 2, 4)
    lows = np.minimum.reduceat(centres, begin, axis=1)
    sizes = np.maximum.reduceat(centres, begin, axis=1) - lows
    with np.errstate(divide="ignore", over="ignore"):
        scales = np.where(sizes > 0, np.float32(bins * 0.999999) / sizes, np.float32(0.0)).astype(np.float32)
    scales[~np.isfinite(scales)] = 0.0
    node = np.repeat(np.arange(nodes), count)
    best = np.full(nodes, np.inf)
    axis_of, bin_of = np.zeros(nodes, np.int64), np.zeros(nodes, np.int64)
    keys = []
    for axis in AXES:
        key = centres[axis] - np.repeat(lows[axis], count)
        key *= np.repeat(scales[axis], count)
        key = key.astype(np.int64)
        key *= nodes
        key += node
        keys.append(key)
        counts = np.bincount(key, minlength=bins * nodes).reshape(bins, nodes)
        low = np.full((3, bins * nodes), np.inf, np.float32)
        high = np.full((3, bins * nodes), -np.inf, np.float32)
        for part in range(3):
            np.minimum.at(low[part], key, boxes[part])
            np.maximum.at(high[part], key, boxes[3 + part])
        cost = _sweep(low.reshape(3, bins, nodes), high.reshape(3, bins, nodes), counts)
        at = cost.argmin(axis=0)
        least = cost[at, np.arange(nodes)]
        better = least < best
        best[better], axis_of[better], bin_of[better] = least[better], axis, at[better]
    side = np.zeros(total, bool)
    for axis, key in enumerate(keys):
        # Keys of later bins are larger than all of this bin.
        last = np.where(axis_of == axis, (bin_of + 1) * nodes, bins * nodes)
        side |= key >= np.repeat(last, count)
    # Halves reach leaves after this many levels; a node that has no more than those left must not be split unevenly.
    halvings = np.ceil(np.log2(np.maximum(count, largest) / largest))
    middle = np.isinf(best) | (halvings >= DEPTH_UPPER - level)
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
