"""Ancestors and descendants in a forest of nodes: levels, subtrees, and products of matrices from the roots down.

A forest is one array: the parent of each node, -1 for roots. Everything else follows from it, and all of it is
computed for many nodes at once, since a loop over nodes in Python costs a hundred times as much.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Places = NDArray[np.intp]
Float64 = NDArray[np.float64]

HIERARCHY = np.dtype(
    [(name, "<i4") for name in ("parent", "first_child", "next_sibling", "last_sibling", "level")]
)
"""A node's links; -1 where there is none. `last_sibling` is a cache: only the first child of a node has it."""


class Ancestry:
    """A forest whose parents do not change. `parent` is (N,) integers without cycles, in any order."""

    def __init__(self, parent: NDArray[np.int32]) -> None:
        self.parent = parent
        self.depth = _depths(parent)
        """(N,) steps up to the root; 0 for roots."""

    @cached_property
    def levels(self) -> list[Places]:
        """The nodes by depth, roots first, ascending in each: all of a level can be computed at once."""
        order = np.argsort(self.depth, kind="stable")
        if len(order) == 0:
            return []
        return np.split(order, np.flatnonzero(np.diff(self.depth[order])) + 1)

    @cached_property
    def _ranks(self) -> tuple[Places, Places, Places]:
        """Nodes level by level, where each node comes in that, and where the levels after the first begin."""
        order = np.concatenate([np.zeros(0, np.intp), *self.levels])
        rank = np.empty(len(order), np.intp)
        rank[order] = np.arange(len(order))
        return order, rank, np.cumsum([len(level) for level in self.levels])[:-1]

    @cached_property
    def siblings(self) -> Places:
        """All nodes, those with the same parent beside each other in ascending order; roots come first."""
        return np.argsort(self.parent, kind="stable")

    @cached_property
    def sizes(self) -> Places:
        """(N,) how many nodes each subtree has, its root included."""
        sizes = np.ones(len(self.parent), np.intp)
        for level in reversed(self.levels[1:]):
            np.add.at(sizes, self.parent[level], sizes[level])
        return sizes

    @cached_property
    def places(self) -> Places:
        """(N,) where each node comes in depth-first order: a subtree is `sizes` places that follow each other.

        A node comes one place after its parent, and further by the subtrees of earlier siblings. The sum of these
        steps up to the root is found as the depths are, by doubling.
        """
        count = len(self.parent)
        before = np.cumsum(self.sizes[self.siblings]) - self.sizes[self.siblings]
        first = np.ones(count, bool)
        first[1:] = np.diff(self.parent[self.siblings]) != 0
        groups = np.cumsum(first) - 1
        step = np.zeros(count + 1, np.intp)
        step[self.siblings] = before - before[first][groups]
        step[:count] += self.parent >= 0
        return _sums_upwards(self.parent, step)

    @cached_property
    def order(self) -> Places:
        """(N,) the nodes in depth-first order, children ascending: what a recursive walk visits."""
        order = np.empty(len(self.parent), np.intp)
        order[self.places] = np.arange(len(order))
        return order

    def subtrees(self, nodes: ArrayLike) -> Places:
        """Return `nodes` (K,) and all their descendants, each once, in depth-first order.

        Subtrees are stretches of that order that either lie apart or inside each other, so one that starts
        before an earlier one has ended is part of it, or the same again.

        Raises:
            IndexError: there is no such node.
        """
        numbers = node_numbers(nodes, len(self.parent))
        if len(numbers) == 0:  # most scenes are never edited: for them nothing is prepared
            return numbers
        first = np.sort(self.places[numbers])
        last = first + self.sizes[self.order[first]]
        apart = np.ones(len(first), bool)
        apart[1:] = first[1:] >= np.maximum.accumulate(last)[:-1]
        first, lengths = first[apart], (last - first)[apart]
        jump = np.repeat(first - np.cumsum(lengths) + lengths, lengths)
        return self.order[jump + np.arange(len(jump))]

    def levels_below(self, nodes: ArrayLike) -> list[Places]:
        """Return the subtrees of `nodes` by depth, upper nodes first, ascending in each."""
        below = self.subtrees(nodes)
        if len(below) == 0:
            return []
        order, rank, firsts = self._ranks
        ranks = np.sort(rank[below])  # sorts of plain numbers are many times as fast as those of places
        parts = np.split(order[ranks], np.searchsorted(ranks, firsts))
        return [part for part in parts if len(part)]

    def links(self) -> np.ndarray:
        """Return the (N,) links of every node (HIERARCHY); siblings follow each other in ascending order."""
        links = np.full(len(self.parent), -1, HIERARCHY)
        links["parent"], links["level"] = self.parent, self.depth
        ordered = self.siblings
        same = np.diff(self.parent[ordered]) == 0
        links["next_sibling"][ordered[:-1][same]] = ordered[1:][same]
        first = ordered[np.append(True, ~same)[: len(ordered)]]
        links["last_sibling"][first] = ordered[np.append(~same, True)[: len(ordered)]]
        below = first[self.parent[first] >= 0]
        links["first_child"][self.parent[below]] = below
        return links

    def compose(self, matrices: Float64, levels: list[Places]) -> int:
        """Turn parent_from_node into world_from_node, in place; return the number of matrix products.

        `matrices` (N, 4, 4) holds the former for the nodes in `levels` (upper ones first) and the latter for
        all others. A level is one product of two stacks.
        """
        products = 0
        for level in levels:
            above = self.parent[level]
            if above[0] >= 0:  # a level has either roots or none
                matrices[level] = matrices[above] @ matrices[level]
                products += len(level)
        return products


def node_numbers(nodes: ArrayLike, count: int) -> Places:
    """Return `nodes` as (K,) numbers of nodes.

    Raises:
        IndexError: one is not among the `count` nodes that there are; no number counts from the end.
    """
    numbers = np.asarray(nodes, np.intp).reshape(-1)
    wrong = numbers[(numbers < 0) | (numbers >= count)]
    if len(wrong):
        raise IndexError(f"there is no node {wrong[0]} among {count}")
    return numbers


def _depths(parent: NDArray[np.int32]) -> Places:
    return _sums_upwards(parent, np.append(parent >= 0, False).astype(np.intp))


def _sums_upwards(parent: NDArray[np.int32], step: Places) -> Places:
    """Return (N,) the sums of `step` (N + 1,) over each node and its ancestors; the last element must be 0.

    Every round doubles how far a node looks up, so a chain of a million nodes takes twenty. The extra last
    element stands above all roots.
    """
    count = len(parent)
    total = step.copy()
    ancestor = np.append(np.where(parent < 0, count, parent), count)
    for _ in range(count.bit_length()):
        if (ancestor == count).all():
            break
        total += total[ancestor]
        ancestor = ancestor[ancestor]
    return total[:count]
