"""Faces, tiles, and places in the pages, as the chapter lays them out."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises import Answer
from tools.exercises.checking import Given


def measure(given: Given) -> dict[str, Answer]:
    """Ask the chapter for its layout."""
    layout: Any = given.module("shadows.layout")
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
    sizes = np.array([2048] + [256] * 7)
    tiles = int((counts * layout.tiles_of(sizes)).sum())
    cubes = np.full(20, 256), np.full(20, 6), np.arange(20, 0, -1.0)
    squeezed = lamps.fitted(*cubes, (16 << 20) // model.TILE_BYTES)
    last = lamps.fitted(*cubes, (1 << 20) // model.TILE_BYTES)
    pool = given.module("page_table.pool").TilePool(64, 7, 64)
    pool.assign(np.arange(64))
    table = pool.table
    row, column = 130 // model.TILE, 300 // model.TILE
    return {
        "faces": int(counts.sum()),
        "tiles": tiles,
        "megabytes": tiles * model.TILE_BYTES / 2**20,
        "tile": row * (512 // model.TILE) + column,
        "x": int(table[23] & 0xFFFF),
        "y": int(table[23] >> 16),
        "whole": int((squeezed == 256).sum()),
        "smallest": int(squeezed.min()),
        "left": int((last > 0).sum()),
    }
