"""Overlap of the boxes of trees that are made by hand, and of trees that the chapter builds."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Boxes apart, one inside the other, flat ones, no node at all, a lonely leaf, and built trees."""
    build: Any = given.module("rays.bvh.build")
    module: Any = given.module("rays.bvh.overlap")
    given.need(
        callable(getattr(module, "overlaps", None)), "rays/bvh/overlap.py has no function overlaps yet."
    )
    rng = np.random.default_rng(4)
    none = np.zeros((0, 3), np.float32)
    cases: dict[str, tuple[np.ndarray, np.ndarray]] = {
        "no triangle": (none, none),
        "a single leaf": (np.zeros((2, 3)), np.ones((2, 3))),
    }
    for count in (5, 60, 900):
        centres, half = rng.uniform(0, 1, (count, 3)), rng.uniform(0, 0.1, (count, 3))
        cases[f"{count} boxes"] = (centres - half, centres + half)
    flat, reach = rng.uniform(0, 1, (50, 3)) * (1, 1, 0), np.array((0.1, 0.1, 0.0))
    cases["boxes in a plane"] = (flat - reach, flat + reach)
    cases["boxes at one place"] = (np.zeros((9, 3)), np.zeros((9, 3)))
    for name, (low, high) in cases.items():
        tree = build.build(np.asarray(low, np.float32), np.asarray(high, np.float32))
        found = np.asarray(module.overlaps(tree), np.float64)
        wanted = np.array([overlap(tree, node) for node in range(len(tree.children))])
        given.need(
            found.shape == wanted.shape,
            f"The tree over {name} has {len(wanted)} nodes, and there are {found.size} numbers.",
        )
        given.need(bool(np.isfinite(found).all()), f"For {name} not all numbers are finite.")
        if len(wanted):
            worst = int(np.abs(found - wanted).argmax())
            given.need(
                abs(found[worst] - wanted[worst]) < 1e-5,
                f"For {name} the boxes of node {worst} overlap by {wanted[worst]:.4f}, and not by {found[worst]:.4f}.",
            )


def overlap(tree: Any, node: int) -> float:
    """Return the half surface that both boxes of a node share, over that of the box around both."""
    low, high = tree.low[node].astype(np.float64), tree.high[node].astype(np.float64)
    around = area(high.max(axis=0) - low.min(axis=0)) if (low <= high).all() else 0.0
    size = high.min(axis=0) - low.max(axis=0)
    return area(size) / around if around > 0 and (size >= 0).all() else 0.0


def area(size: np.ndarray) -> float:
    """Return half the surface of a box with these edges."""
    x, y, z = size.tolist()
    return float(x * y + y * z + z * x)
