"""Places of random points in the pages, by a table in random order, of which some words have no tile."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tools.exercises.checking import Given

NONE = 0xFFFFFFFF
"""The word of a tile without memory."""

BOX = np.array([(-8.0, 0.0, -8.0), (8.0, 6.0, 8.0)])


def check(given: Given) -> None:
    """Points in all faces of two lamps and a sun, behind a lamp, and outside of a face."""
    function: Any = getattr(given.module("shadows.where"), "place_of", None)
    given.need(callable(function), "shadows/where.py has no function place_of yet.")
    faces, table = _faces(given)
    random = np.random.default_rng(8)
    hits = 0
    for number, face in enumerate(faces):
        points = random.uniform(BOX[0], BOX[1], (120, 3))
        points[0] = face["origin"] - 0.5 * face["ahead"]
        for position in points:
            wanted = _place(face, table, position)
            answer = function(faces.copy(), table.copy(), number, position.copy())
            where = f"In face {number} the point ({position[0]:.2f}, {position[1]:.2f}, {position[2]:.2f})"
            if wanted is None:
                given.need(
                    answer is None,
                    f"{where} is outside of the face or behind its light, or its tile has no memory, and it has the "
                    f"place {answer}.",
                )
                continue
            hits += 1
            given.need(
                isinstance(answer, tuple) and len(answer) == 3,
                f"{where} is in the face, and the result is {answer}, no column, row and layer.",
            )
            given.need(
                tuple(int(one) for one in answer) == wanted,
                f"{where} has its texel at {wanted} of the pages, and the result is {answer}.",
            )
    assert hits > 300, "too few points are inside"


def _faces(given: Given) -> tuple[np.ndarray, np.ndarray]:
    """Return faces of a point light, a spot and a sun, and a table whose tiles lie anywhere."""
    faces: Any = given.module("shadows.faces")
    cascades: Any = given.module("shadows.cascades")
    packing: Any = given.module("scene.packing")
    lights = np.zeros(2, packing.LIGHT)
    lights["kind"] = packing.LIGHT_KINDS["point"], packing.LIGHT_KINDS["spot"]
    lights["position"], lights["direction"] = (
        ((0.5, 3.0, -1.0), (-6.0, 5.0, 6.0)),
        ((0, 0, -1), (0.6, -0.53, -0.6)),
    )
    cosine = np.cos(np.radians(50.0))
    lights["cone"][1, :2] = 1 / (1 - cosine), -cosine / (1 - cosine)
    local, *_ = faces.local_faces(
        lights, np.arange(2), np.array([40, 512]), 0.01, np.full(2, 40.0), np.full(2, 3)
    )
    view = View(pose_looking_at((0, 1.7, 6), (0, 1.7, 0)), Perspective(1.0, 0.05))
    sun = np.array([(0.4, -1.0, 0.3)]) / np.sqrt(1.25)
    made = np.concatenate([cascades.directional_faces(sun, BOX, view, np.zeros(3), 1.5, 2, 512, 3), local])
    sizes = made["size"].astype(np.int64)
    side = np.where(sizes < 128, 0, sizes // 128)
    tiles = side**2
    made["tiles"], made["first"] = np.maximum(side, 1), np.cumsum(tiles) - tiles
    small = np.flatnonzero(sizes < 128)  # they share a tile, the last one
    made["first"][small] = tiles.sum()
    made["offset"][small] = np.stack(
        [42 * (np.arange(len(small)) % 3), 42 * (np.arange(len(small)) // 3)], axis=1
    )
    number = np.random.default_rng(3).permutation(int(tiles.sum()) + 1)
    table = (number % 5 | number // 5 % 3 << 8 | number // 15 << 16).astype(np.uint32)
    table[1:-1:3] = NONE
    return made, table


def _place(face: np.ndarray, table: np.ndarray, position: np.ndarray) -> tuple[int, int, int] | None:
    """Return column, row and layer, in other words than a shader has."""
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    p = axes @ (position - face["origin"])
    if p[2] <= face["near"]:
        return None
    texel = (
        p[:2] * (face["scale_x"], face["scale_y"]) / (p[2] if face["perspective"] else 1.0) + face["size"] / 2
    )
    x, y = (int(one) for one in np.floor(texel))
    if min(x, y) < 0 or max(x, y) >= face["size"]:
        return None
    x, y = x + int(face["offset"][0]), y + int(face["offset"][1])
    word = int(table[face["first"] + y // 128 * face["tiles"] + x // 128])
    if word == NONE:
        return None
    column, row, layer = word % 256, word // 256 % 256, word // 65536
    return column * 128 + x % 128, row * 128 + y % 128, layer
