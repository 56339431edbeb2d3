"""Costs, edges, codes, records and offsets by the functions of the chapter."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given


def measure(given: Given) -> dict[str, Answer]:
    """Evaluate what the chapter does, with small numbers."""
    build: Any = given.module("rays.bvh.build")
    model: Any = given.module("rays.bvh.model")
    morton: Any = given.module("rays.bvh.morton")
    rays: Any = given.module("rays.model")
    pipelines: Any = given.module("pipelines.vulkan_rays")
    # Two leaves in a box of 4 x 2 x 2: 3 triangles in a part of 2 x 2 x 2, and 1 in one of 1 x 2 x 2.
    tree = build.Tree(
        np.arange(4),
        np.array([[~0, ~1]]),
        np.array([[(0, 0, 0), (3, 0, 0)]], np.float32),
        np.array([[(2, 2, 2), (4, 2, 2)]], np.float32),
        np.array([0, 3]),
        np.array([3, 1]),
        [0, 1],
    )
    p, q = (1, 2), (3, 4)
    code = int(model.leaf_code(np.array([9]), np.array([3]))[0])
    cell = [int(part) for part in morton.spread(np.array([3, 0, 1], np.uint64))]
    limits = pipelines.RayLimits(32, 64, 64, 1, 1 << 30, 4096)
    _, size = pipelines.table_layout((1, 2, 1, 0), limits)
    return {
        "cost": build.sah_cost(tree),
        "edge": float(q[0] * p[1] - q[1] * p[0]),
        "leaf": (code >> model.COUNT_SHIFT & 3) + 1,
        "cell": cell[0] << 2 | cell[1] << 1 | cell[2],
        "table": size,
        "record": 3 + 1 + 2 * 4,
        "mask": "it passes" if rays.SURFACES & rays.BLENDED == 0 else "it is hit",
        "offset": 1e3 * 7 * 1000 / 2**24,
        "rays": 1 + 3 + 2 * (1 + 3),
    }
