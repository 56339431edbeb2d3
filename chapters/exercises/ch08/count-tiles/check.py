"""Faces, tiles, and places in the pages, as the chapter lays them out and gives them away."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its layout."""
    faces: Any = given.module("shadows.faces")
    lamps: Any = given.module("page_table.lamps")
    model: Any = given.module("shadows.model")
    packing: Any = given.module("scene.packing")
    kinds = packing.LIGHT_KINDS
    lights = np.zeros(8, packing.LIGHT)
    lights["kind"] = [kinds["directional"], *[kinds["spot"]] * 3, *[kinds["point"]] * 4]
    for number, degrees in ((1, 40.0), (2, 40.0), (3, 70.0)):
        cosine = np.cos(np.radians(degrees))
        lights["cone"][number, :2] = 1 / (1 - cosine), -cosine / (1 - cosine)
    counts = np.where(faces.has_cube(lights), 6, 1)
    counts[0] = 3
    # Words of cascades of 16x16 tiles, and tiles of lamps at level 3: faces of 256 texels.
    suns = model.Places(suns=1, cascades=3, sun_side=16, lamps=7, lamp_side=2, coarse=False).lamp_word
    tiles = suns + int(lamps.whole_costs(counts[1:], 3, False)[:, 3].sum())
    cubes, order = np.full(20, 6), np.arange(20, 0, -1.0)
    costs, asked = lamps.whole_costs(cubes, 3, False), np.full(20, 3)
    squeezed = lamps.fitted(asked, cubes, order, costs, (16 << 20) // model.TILE_BYTES)
    last = lamps.fitted(asked, cubes, order, costs, (1 << 20) // model.TILE_BYTES)
    pool = given.module("page_table.pool").TilePool(64, (7, 10), 64)
    pool.assign(np.arange(64))
    table = pool.table
    row, column = 130 // model.TILE, 300 // model.TILE
    return {
        "faces": int(counts.sum()),
        "tiles": tiles,
        "megabytes": tiles * model.TILE_BYTES / 2**20,
        "tile": row * (512 // model.TILE) + column,
        "x": int(table[23] & 0xFF),
        "y": int(table[23] >> 8 & 0xFF),
        "whole": int((squeezed == 3).sum()),
        "smallest": int(lamps.sizes_of(squeezed, cubes).min()),
        "left": int((last > 0).sum()),
        "coarse": _held(given, moving=False),
        "moving": _held(given, moving=True),
    }


def _held(given: Given, moving: bool) -> int:
    """Return the tiles of a point light with faces of 256 texels, of which the picture reads two faces."""
    model: Any = given.module("shadows.model")
    lamps: Any = given.module("page_table.lamps")
    residency: Any = given.module("page_table.residency")
    places = model.Places(suns=0, cascades=3, sun_side=0, lamps=1, lamp_side=2, coarse=True)
    slots = lamps.Lamps(1, lamps.level_of_side(places.lamp_side))
    slots.choose(np.array([1.0]), np.array([6]), 0)
    pool = given.module("page_table.pool").TilePool(64, (8, 8), places.words)
    held = residency.Residency(pool, places, slots, 256, lambda tiles: 64)
    read = np.zeros(places.coarse_word, bool)
    read[: 2 * places.lamp_side**2] = True
    held.follow(residency.Need(np.array([256.0]), read), True, np.array([moving]))
    used: int = pool.used
    return used
