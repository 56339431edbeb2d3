"""The first split of trees, against the best of all splits of sorted boxes."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Three lists of boxes: a crowd beside a few, long ones among small ones, and boxes everywhere."""
    build: Any = given.module("rays.bvh.build")
    for name, low, high in cases():
        tree = build.build(low, high)
        counts = [int(below(tree, side)) for side in (0, 1)]
        given.need(
            sum(counts) == len(low), f"The tree over {name} has {sum(counts)} triangles of {len(low)}."
        )
        cost = sum(count * area(tree.low[0, side], tree.high[0, side]) for side, count in enumerate(counts))
        best = best_split(low, high)
        given.need(
            cost <= 1.1 * best,
            f"The first split of {name} is expected to cost {cost:.3f}, and the best one {best:.3f}.",
        )


def cases() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return names, low and high corners (N, 3) float32."""
    rng = np.random.default_rng(12)
    crowd = rng.uniform(0, 1, (2000, 3)) * (0.3, 1, 1)
    few = rng.uniform(0, 1, (40, 3)) * (3, 1, 1) + (0.3, 0, 0)
    everywhere = rng.uniform(0, 1, (800, 3)) * (1, 2, 3)
    long = np.concatenate([rng.uniform(0, 1, (600, 3)) * (0.2, 0.2, 1), rng.uniform(0, 1, (60, 3)) * 2])
    found = []
    for name, centres in (
        ("a crowd beside a few", np.concatenate([crowd, few])),
        ("few and many", long),
        ("boxes everywhere", everywhere),
    ):
        half = rng.uniform(0, 0.01, centres.shape)
        found.append((name, (centres - half).astype(np.float32), (centres + half).astype(np.float32)))
    return found


def area(low: np.ndarray, high: np.ndarray) -> float:
    """Return half the surface of a box."""
    x, y, z = (high - low).astype(np.float64)
    return float(x * y + y * z + z * x)


def best_split(low: np.ndarray, high: np.ndarray) -> float:
    """Return the least cost of all splits of boxes that are sorted by their centres along an axis."""
    best = np.inf
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        before = np.minimum.accumulate(low[order]), np.maximum.accumulate(high[order])
        after = np.minimum.accumulate(low[order][::-1])[::-1], np.maximum.accumulate(high[order][::-1])[::-1]
        for count in range(1, len(low)):
            left, right = (
                area(before[0][count - 1], before[1][count - 1]),
                area(after[0][count], after[1][count]),
            )
            best = min(best, left * count + right * (len(low) - count))
    return float(best)


def below(tree: Any, side: int) -> int:
    """Return how many boxes lie below a child of the root."""
    waiting, total = [int(tree.children[0, side])], 0
    while waiting:
        code = waiting.pop()
        if code < 0:
            total += int(tree.count[~code])
        else:
            waiting += [int(child) for child in tree.children[code]]
    return total
