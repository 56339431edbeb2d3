"""The tree by which a vertex of a path draws one of many lights: where they are, how far they reach, and their power.

Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting". This tree is complete:
lights are halved along the longest axis of each group, and the places that are left have no power. So a node needs no
list of children, and all lanes of a processor take equally many steps. `light_tree.glsl` draws from it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FEW = 16
"""Lights up to which a vertex looks at each of them: that takes less time than the tree, and draws exactly."""

NODE_RECORDS = 2
"""Records of 16 bytes of a node: low corner and power, high corner and the square of the reach."""

LEAST_POWER = 1e-9
"""Of the brightest light: no light has less, so that none loses its probability to rounding."""

ROUNDED = 1.0 + 1e-4
"""Reaches are this much larger, since shaders round distances."""

FARTHEST2 = 1e38


def leaves_for(count: int) -> int:
    """Return the number of leaves of the tree of so many lights, a power of two; 0 without a tree."""
    return 0 if count <= FEW else 1 << (count - 1).bit_length()


def room(count: int) -> int:
    """Return the records of 16 bytes of the tree of so many lights: nodes from number 0 on, then the lights of leaves.

    The root is node 1 and the children of node n are 2n and 2n + 1, so that node 0 is not used.
    """
    leaves = leaves_for(count)
    return 2 * leaves * NODE_RECORDS + leaves // 4


def leaves_of(tree: NDArray[np.uint32]) -> int:
    """Return the leaves of a tree of `room` records."""
    return 4 * len(tree) // (8 * NODE_RECORDS + 1)


def light_tree(records: np.ndarray, first: int) -> NDArray[np.uint32]:
    """Return the records (room, 4) of the tree of the LIGHT records from number `first` on, which have a place."""
    lights = records[first:]
    leaves = leaves_for(len(lights))
    if not leaves:
        return np.zeros((0, 4), np.uint32)
    position = np.full((leaves, 3), np.nan)
    position[: len(lights)] = lights["position"]
    order = _halved(position)
    strongest = lights["color"].astype(np.float64).max(axis=1)
    brightest = max(float(strongest.max()), 1e-300)
    power, reach2 = np.zeros(leaves), np.zeros(leaves)
    power[: len(lights)] = np.where(strongest > 0.0, np.maximum(strongest / brightest, LEAST_POWER), 0.0)
    with np.errstate(divide="ignore"):
        ranges2 = 1.0 / lights["inverse_range2"].astype(np.float64)
    ends2 = np.minimum(ranges2, lights["end_distance2"].astype(np.float64))
    reach2[: len(lights)] = np.minimum(ends2 * ROUNDED, FARTHEST2)
    shines = power > 0.0
    low = np.where(shines[:, None], position, np.inf)[order]
    high = np.where(shines[:, None], position, -np.inf)[order]
    power, reach2 = power[order], np.where(shines, reach2, 0.0)[order]
    nodes = np.zeros((2 * leaves, 8), np.float32)
    nodes[leaves:] = np.column_stack([low, power, high, reach2])
    for begin in (leaves >> level for level in range(1, leaves.bit_length())):
        low, high = (bound.reshape(begin, 2, 3) for bound in (low, high))
        low, high = low.min(axis=1), high.max(axis=1)
        power, reach2 = power.reshape(begin, 2).sum(axis=1), reach2.reshape(begin, 2).max(axis=1)
        nodes[begin : 2 * begin] = np.column_stack([low, power, high, reach2])
    nodes[nodes[:, 3] == 0.0] = 0.0  # no power: no corners without end
    numbers = (order + first).astype(np.uint32)
    return np.concatenate([nodes.view(np.uint32).reshape(-1, 4), numbers.reshape(-1, 4)])


def _halved(position: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the order of places (2^k, 3) in which each half of a group is one side of it; NaN is no place."""
    count = len(position)
    order = np.arange(count)
    known = np.isfinite(position)
    for size in (count >> level for level in range(int(math.log2(count)))):
        groups = order.reshape(-1, size)
        there, places = known[groups], position[groups]
        spread = np.where(there, places, -np.inf).max(axis=1) - np.where(there, places, np.inf).min(axis=1)
        axis = spread.argmax(axis=1)
        keys = np.take_along_axis(places, axis[:, None, None], axis=2)[
            ..., 0
        ]  # NaN is sorted behind all numbers
        order = np.take_along_axis(groups, keys.argsort(axis=1, kind="stable"), axis=1).reshape(-1)
    return order
