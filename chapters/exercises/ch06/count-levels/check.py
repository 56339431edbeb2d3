"""Sizes of the pyramid, levels of rectangles, and the meshlets of a cube and of a grid."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np

from tests.support.towns import cube, grid, of_shapes
from tools.exercises import Answer
from tools.exercises.checking import Given


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its layout and its meshlets; the levels follow from the rule of the task."""
    layout: Any = given.module("culling.pyramid").PyramidLayout
    build: Any = given.module("meshlets.build").build_meshlets
    scene = of_shapes([cube(), grid(70)], [0, 0], np.array([0, 1]), np.tile(np.eye(4), (2, 1, 1)))
    numbers = build(scene).ranges[:, 1].tolist()
    return {
        "levels": len(layout.of((1280, 720)).levels),
        "odd_width": layout.of((1281, 721)).extent(3)[0],
        "dispatches": len(layout.of((1920, 1080)).reductions),
        "texels": sum(level.width * level.height for level in layout.of((13, 9)).levels),
        "aligned": _level(96, 127),
        "shifted": _level(100, 131),
        "single": _level(7, 7),
        "cube": numbers[0],
        "grid": numbers[1],
    }


def _level(first: int, last: int) -> int:
    """Return the lowest level, from 1 on, at which a row of pixels lies in at most two texels."""
    return next(level for level in count(1) if (last >> level) - (first >> level) <= 1)
