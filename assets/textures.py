"""Procedural textures of walls, floors and wood: colour, relief and finish from noise and a little geometry.

Colours are written as they appear (sRGB-coded), the way a painter mixes them; every other channel is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assets.noise import (
    Bytes,
    bytes_of,
    fbm,
    mix,
    normal_map,
    per_cell,
    pixel_grid,
    smoothstep,
    surface_map,
    tint,
)


@dataclass(frozen=True)
class Maps:
    """The three pictures of one material: base colour, normals, and occlusion-roughness-metalness."""

    base: Bytes
    normal: Bytes
    surface: Bytes


def limestone(px: int) -> Maps:
    """Return pale dressed stone for columns and arches, 1 repeat = 1.2 m: bedding, pits and weather."""
    grain = fbm(px, 6, 5, 11, 0.6)
    bedding = fbm(px, (2, 12), 3, 21)
    pits = smoothstep(0.66, 0.86, fbm(px, 40, 3, 31)) * smoothstep(0.5, 0.65, fbm(px, 4, 2, 36))
    value = 0.80 + 0.16 * (grain - 0.5) + 0.14 * (bedding - 0.5) - 0.12 * pits
    stained = smoothstep(0.52, 0.75, fbm(px, 3, 4, 41))
    color = tint((1.0, 0.945, 0.84), value) * (1 - 0.14 * stained[..., None] * np.array([0.4, 0.8, 1.5]))
    height = 0.5 * grain + 0.4 * bedding - 0.35 * pits
    return Maps(
        bytes_of(color),
        normal_map(height, 0.010),
        surface_map(1 - 0.5 * pits, 0.78 + 0.2 * (grain - 0.5) + 0.1 * pits, 0.0),
    )


def worn_wall(px: int) -> Maps:
    """Return coloured plaster that has come off the bricks here and there, 1 repeat = 3 m."""
    x, y = pixel_grid(px)
    rows, columns = 36, 12
    row = np.floor(y * rows).astype(np.int64)
    along = x * columns + 0.5 * (row % 2)
    brick = np.floor(along).astype(np.int64) % columns + columns * row
    to_joint = np.minimum(
        np.minimum(along % 1.0, 1 - along % 1.0) * (3.0 / columns),
        np.minimum(y * rows % 1.0, 1 - y * rows % 1.0) * (3.0 / rows),
    )  # metres
    in_brick = smoothstep(0.004, 0.012, to_joint)
    grain = fbm(px, 16, 4, 51)
    each = per_cell(brick, 61)
    brick_color = tint((0.66, 0.38, 0.28), 0.75 + 0.4 * each + 0.3 * (grain - 0.5))
    mortar = tint((0.66, 0.61, 0.53), 0.9 + 0.3 * (grain - 0.5))
    bare = mix(mortar, brick_color, in_brick[..., None])
    # The plaster's edge is ragged at every scale and stays away from most of the wall.
    cover = fbm(px, 2, 7, 71, 0.55)
    plaster = smoothstep(0.345, 0.353, cover)
    rim = smoothstep(0.395, 0.350, cover) * plaster
    clouds = fbm(px, 3, 6, 81, 0.6)
    painted = tint((0.80, 0.55, 0.40), 0.92 + 0.34 * (clouds - 0.5) + 0.10 * (grain - 0.5))
    painted = mix(painted, np.array([0.86, 0.80, 0.70]), 0.55 * rim[..., None])
    color = mix(bare, painted, plaster[..., None])
    height = mix(0.35 * in_brick + 0.1 * grain, 0.75 + 0.12 * clouds + 0.06 * grain, plaster)
    occlusion = mix(0.62 + 0.3 * in_brick, 1.0, plaster)
    return Maps(
        bytes_of(color),
        normal_map(height, 0.008),
        surface_map(occlusion, mix(0.92, 0.80 + 0.2 * (clouds - 0.5), plaster), 0.0),
    )


def floor_tiles(px: int) -> Maps:
    """Return polished marble squares with dark diamonds at their corners, 1 repeat = 2.4 m of 4 x 4 tiles."""
    count = 4
    x, y = pixel_grid(px)
    column, row = np.floor(x * count).astype(np.int64), np.floor(y * count).astype(np.int64)
    across, down = x * count - column - 0.5, y * count - row - 0.5  # -0.5..0.5 inside a tile
    to_corner = (0.5 - np.abs(across)) + (0.5 - np.abs(down))
    diamond = to_corner < 0.21
    to_grout = np.where(
        diamond,
        (0.21 - to_corner) / np.sqrt(2.0),
        np.minimum(np.minimum(0.5 - np.abs(across), 0.5 - np.abs(down)), (to_corner - 0.21) / np.sqrt(2.0)),
    )
    tile = smoothstep(0.006, 0.020, to_grout)
    index = row * count + column
    veins = np.abs(fbm(px, 4, 6, 91, 0.6) - 0.5 + 0.25 * (per_cell(index, 101) - 0.5))
    vein = smoothstep(0.045, 0.0, veins)
    cloud = fbm(px, 8, 4, 111)
    light = (row + column) % 2 == 0
    value = 0.94 + 0.12 * (per_cell(index, 121) - 0.5) + 0.16 * (cloud - 0.5)
    pale = tint((0.87, 0.82, 0.73), value) - 0.16 * vein[..., None]
    rose = tint((0.72, 0.53, 0.43), value) + 0.10 * vein[..., None]
    dark = tint((0.17, 0.24, 0.22), 0.9 + 0.5 * (cloud - 0.5)) + 0.15 * vein[..., None]
    color = np.where(diamond[..., None], dark, np.where(light[..., None], pale, rose))
    color = mix(np.array([0.50, 0.45, 0.38]), color, tile[..., None])
    worn = fbm(px, 3, 4, 131)
    roughness = mix(0.85, 0.24 + 0.34 * smoothstep(0.35, 0.7, worn), tile)
    return Maps(
        bytes_of(color),
        normal_map(tile + 0.05 * cloud, 0.0035),
        surface_map(mix(0.55, 1.0, smoothstep(0.0, 0.03, to_grout)), roughness, 0.0),
    )


def zellige(px: int) -> Maps:
    """Return glazed mosaic of eight-pointed stars, 1 repeat = 0.5 m of 2 x 2 stars."""
    x, y = pixel_grid(px)
    across, down = (
        np.abs(x * 2 % 1.0 * 2 - 1),
        np.abs(y * 2 % 1.0 * 2 - 1),
    )  # 0 at a star's heart, 1 at the cell's edge
    square, turned = np.maximum(across, down), (across + down) / np.sqrt(2.0)
    star = np.minimum(square, turned)  # below r inside the union of two squares of half width r
    gem = np.maximum(square, turned)  # below r inside their common octagon
    bands = (gem < 0.24, star < 0.36, star < 0.60)
    colors = ((0.85, 0.62, 0.22), (0.90, 0.87, 0.79), (0.08, 0.25, 0.50), (0.16, 0.44, 0.38))
    diagonal = smoothstep(0.10, 0.11, np.abs(across - down)) * (square > 0.74)
    color = np.where((diagonal > 0)[..., None], colors[1], colors[3])
    for inside, paint in zip(bands[::-1], colors[2::-1], strict=True):
        color = np.where(inside[..., None], paint, color)
    lines = np.minimum.reduce(
        [
            np.abs(gem - 0.24),
            np.abs(star - 0.36),
            np.abs(star - 0.60),
            np.where(star > 0.60, np.abs(across - down), 1),
        ]
    )
    lines = np.where(star < 0.6, lines, np.minimum(lines, np.abs(square - 0.985)))
    tile = smoothstep(0.008, 0.035, lines)
    glaze = fbm(px, 12, 4, 141)
    color = color * (0.86 + 0.28 * glaze[..., None])
    color = mix(np.array([0.60, 0.55, 0.47]), color, tile[..., None])
    return Maps(
        bytes_of(color),
        normal_map(tile + 0.35 * fbm(px, 6, 2, 151), 0.004),
        surface_map(mix(0.6, 1.0, tile), mix(0.8, 0.16 + 0.2 * glaze, tile), 0.0),
    )


def wood(px: int) -> Maps:
    """Return four dark planks side by side with the grain along v, 1 repeat = 0.8 m."""
    x, _ = pixel_grid(px)
    plank = np.floor(x * 4).astype(np.int64)
    to_gap = np.minimum(x * 4 % 1.0, 1 - x * 4 % 1.0)
    gap = smoothstep(0.012, 0.05, to_gap)
    wave = fbm(px, (4, 1), 4, 161)
    rings = np.abs((wave * 9 + 3 * per_cell(plank, 171)) % 1.0 * 2 - 1)
    fibre = fbm(px, (48, 2), 3, 181)
    value = 0.62 + 0.22 * rings + 0.34 * (fibre - 0.5) + 0.22 * (per_cell(plank, 191) - 0.5)
    color = tint((0.56, 0.37, 0.23), value) * mix(0.35, 1.0, gap)[..., None]
    return Maps(
        bytes_of(color),
        normal_map(0.8 * gap + 0.12 * rings + 0.12 * fibre, 0.010),
        surface_map(mix(0.35, 1.0, gap), 0.62 + 0.2 * (fibre - 0.5), 0.0),
    )


def roof_tiles(px: int) -> Maps:
    """Return rows of half-round clay tiles, v down the slope, 1 repeat = 1.2 m of 6 x 4 tiles."""
    x, y = pixel_grid(px)
    column, row = np.floor(x * 6).astype(np.int64), np.floor(y * 4).astype(np.int64)
    across, down = x * 6 % 1.0 * 2 - 1, y * 4 % 1.0
    bulge = np.sqrt(np.maximum(0.0, 1 - (across / 0.92) ** 2))
    height = bulge + 0.35 * down  # each tile lies over the next one down the slope
    each = per_cell(row * 6 + column, 201)
    grain = fbm(px, 12, 4, 211)
    value = (0.74 + 0.34 * each + 0.3 * (grain - 0.5)) * mix(0.42, 1.0, smoothstep(0.0, 0.5, bulge))
    value = value * mix(0.55, 1.0, smoothstep(0.0, 0.10, down))
    color = tint((0.74, 0.42, 0.29), value)
    occlusion = mix(0.35, 1.0, smoothstep(0.0, 0.7, bulge)) * mix(0.6, 1.0, smoothstep(0.0, 0.12, down))
    return Maps(
        bytes_of(color), normal_map(height, 0.045), surface_map(occlusion, 0.8 + 0.2 * (grain - 0.5), 0.0)
    )


def bronze(px: int) -> Maps:
    """Return hammered metal, bright where touched and dull in the dents, 1 repeat = 0.4 m."""
    dents = fbm(px, 10, 3, 221)
    worn = smoothstep(0.35, 0.65, fbm(px, 3, 5, 231, 0.6))
    color = mix(np.array([0.62, 0.50, 0.34]), np.array([0.93, 0.74, 0.42]), worn[..., None])
    return Maps(
        bytes_of(color),
        normal_map(dents, 0.012),
        surface_map(0.75 + 0.25 * smoothstep(0.25, 0.5, dents), mix(0.52, 0.24, worn), mix(0.85, 1.0, worn)),
    )
