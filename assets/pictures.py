"""Textures that are pictures: leaves, ironwork, cloth, glass, lamp, and the garden seen through the portal."""

from __future__ import annotations

import math

import numpy as np

from assets.noise import (
    Bytes,
    Float64,
    bytes_of,
    fbm,
    mix,
    normal_map,
    pixel_grid,
    smoothstep,
    surface_map,
    tint,
    value_noise,
)
from assets.textures import Maps


def leaves(px: int) -> Bytes:
    """Return a twig with leaves, growing up from the middle of the bottom edge, with alpha for a mask.

    Colour goes on outside the mask: filtering then never mixes in a dark fringe.
    """
    x, y = pixel_grid(px)
    across, up = x - 0.5, 1 - y
    stem = 0.03 * np.sin(up * 5.0)
    alpha = np.where(np.abs(across - stem) < mix(0.014, 0.004, up), 1.0, 0.0) * (up < 0.86)
    color = np.broadcast_to([0.25, 0.36, 0.13], (px, px, 3))
    rng = np.random.default_rng(241)
    pairs = [(0.05 + 0.105 * k, (-1) ** k * (56 - 3.5 * k), 0.46 - 0.022 * k) for k in range(8)]
    leaf_list = [*pairs, (0.74, 4.0, 0.25)]
    for foot, degrees, length in leaf_list:
        angle = math.radians(degrees + rng.uniform(-8, 8))
        shade = 0.80 + 0.40 * rng.random()
        dx, dy = across - 0.03 * math.sin(foot * 5.0), up - foot
        along = (dx * math.sin(angle) + dy * math.cos(angle)) / length
        side = (dx * math.cos(angle) - dy * math.sin(angle)) / length
        side = side - 0.10 * along * along  # leaves bend a little
        width = 0.40 * np.sqrt(np.clip(along, 0, 1)) * np.clip(1 - along, 0, 1) * 1.5
        inside = (np.abs(side) < width) & (along > 0) & (along < 1)
        rib = smoothstep(0.030, 0.0, np.abs(side))
        veins = smoothstep(0.6, 1.0, np.abs(((along - 0.8 * np.abs(side)) * 9) % 1.0 * 2 - 1))
        value = shade * (0.82 + 0.28 * along + 0.30 * rib - 0.10 * veins)
        color = np.where(inside[..., None], tint((0.30, 0.47, 0.15), value), color)
        alpha = np.where(inside, 1.0, alpha)
    return bytes_of(np.concatenate([color, alpha[..., None]], -1))


def lattice(px: int) -> Bytes:
    """Return a wrought-iron panel, two rings side by side between bars, with alpha for a mask."""
    x, y = pixel_grid(px)
    across, down = x * 2 % 1.0 * 2 - 1, y * 2 - 1
    radius = np.sqrt(across**2 + down**2)
    diagonal = np.minimum(np.abs(across - down), np.abs(across + down)) / math.sqrt(2.0)
    bars = np.minimum.reduce(
        [
            np.abs(radius - 0.80),
            np.abs(radius - 0.34),
            np.where((radius > 0.34) & (radius < 0.80), diagonal, 1.0),
            np.minimum(np.abs(across), np.where(radius > 0.8, 1.0, 1.0)) + (radius < 0.8),
            1 - np.abs(across),
            np.where(np.abs(down) > 0.90, 0.0, 1.0),
        ]
    )
    alpha = np.where(bars < 0.055, 1.0, 0.0)
    rust = fbm(px, 6, 4, 251)
    color = mix(
        np.array([0.10, 0.10, 0.11]), np.array([0.24, 0.15, 0.10]), smoothstep(0.45, 0.75, rust)[..., None]
    )
    return bytes_of(np.concatenate([color, alpha[..., None]], -1))


def damask(px: int) -> Maps:
    """Return woven cloth with a pattern in two tones of grey, for a material's colour to dye, 1 repeat = 0.6 m."""
    x, y = pixel_grid(px)
    ogee = np.cos(2 * np.pi * x) + np.cos(2 * np.pi * y)
    line = smoothstep(0.20, 0.12, np.abs(np.abs(ogee) - 0.42))
    flower = np.zeros_like(x)
    for cx, cy in ((0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
        dx, dy = x - cx, y - cy
        radius, angle = np.sqrt(dx * dx + dy * dy), np.arctan2(dy, dx + 1e-9)
        petals = 0.17 + 0.055 * np.cos(8 * angle)
        flower = np.maximum(flower, smoothstep(0.012, -0.012, np.abs(radius - petals * 0.7) - 0.055))
    pattern = np.maximum(line, flower)
    threads = 96
    warp, weft = np.abs((x * threads) % 1.0 * 2 - 1), np.abs((y * threads) % 1.0 * 2 - 1)
    over = (np.floor(x * threads) + np.floor(y * threads)) % 2
    weave = np.where(over > 0, 1 - warp, 1 - weft)
    value = mix(0.66, 1.0, pattern) * (0.90 + 0.10 * weave) * (0.96 + 0.08 * fbm(px, 4, 3, 261))
    return Maps(
        bytes_of(tint((1.0, 1.0, 1.0), value)),
        normal_map(0.5 * weave + 0.8 * pattern, 0.0035),
        surface_map(0.85 + 0.15 * weave, mix(0.92, 0.62, pattern), 0.0),
    )


def stained_glass(px: int) -> Bytes:
    """Return coloured panes between lead, alpha below one where there is glass, for an alpha-blended material."""
    x, y = pixel_grid(px)
    across, down = np.abs(x * 2 - 1), np.abs(y * 4 % 2 - 1)
    square, turned = np.maximum(across, down), (across + down) / math.sqrt(2.0)
    star = np.minimum(square, turned)
    gem = np.maximum(square, turned)
    paints = ((0.98, 0.80, 0.30), (0.86, 0.16, 0.12), (0.12, 0.36, 0.80), (0.14, 0.62, 0.46))
    color = np.where((square < 0.93)[..., None], paints[3], paints[0])
    for inside, paint in ((star < 0.70, paints[2]), (star < 0.46, paints[1]), (gem < 0.26, paints[0])):
        color = np.where(inside[..., None], paint, color)
    lead = np.minimum.reduce(
        [np.abs(star - 0.70), np.abs(star - 0.46), np.abs(gem - 0.26), np.abs(square - 0.93)]
    )
    lead = np.minimum(lead, np.where(star > 0.70, np.minimum(np.abs(across - down), 1), 1))
    opaque = smoothstep(0.045, 0.025, lead)
    ripple = 0.85 + 0.3 * fbm(px, 5, 3, 271)
    color = mix(color * ripple[..., None], np.array([0.10, 0.10, 0.11]), opaque[..., None])
    return bytes_of(np.concatenate([color, mix(0.42, 1.0, opaque)[..., None]], -1))


def filigree(px: int) -> Bytes:
    """Return pierced metal as light sees it: warm where a lamp shines through, black where it does not."""
    x, y = pixel_grid(px)
    across, down = np.abs(x * 4 % 1.0 * 2 - 1), np.abs(y * 4 % 1.0 * 2 - 1)
    square, turned = np.maximum(across, down), (across + down) / math.sqrt(2.0)
    hole = smoothstep(0.66, 0.58, np.minimum(square, turned)) * smoothstep(
        0.20, 0.26, np.maximum(square, turned)
    )
    glow = hole * (1.0 - 0.55 * np.abs(y - 0.55))
    return bytes_of(tint((1.0, 0.74, 0.40), glow))


def sky(width: int, height: int) -> Bytes:
    """Return half the round of an evening sky, zenith in the top row and horizon in the bottom one; it repeats in u."""
    _, y = pixel_grid(width, height)
    low = smoothstep(0.45, 1.0, y)[..., None]
    color = mix(
        np.array([0.34, 0.53, 0.77]), np.array([0.66, 0.78, 0.87]), smoothstep(0.0, 0.8, y)[..., None]
    )
    color = mix(color, np.array([0.98, 0.86, 0.68]), low)
    # Clouds lie on a plane: seen from below, what is one row of their noise there gets thinner towards the horizon.
    distance = 1.0 / np.tan(np.radians(90.0 * np.clip(1.0 - y[:, 0], 0.02, 0.98)))
    row = np.clip((np.log(distance) + 3.0) / 6.5, 0.0, 1.0) * (width - 1)
    noise = fbm(width, (7, 9), 6, 331, 0.55)[row.astype(np.int64)]
    cover = smoothstep(0.52, 0.72, noise) * smoothstep(0.06, 0.30, y) * smoothstep(1.0, 0.86, y)
    light = mix(
        np.array([0.86, 0.80, 0.80]), np.array([1.0, 0.95, 0.86]), smoothstep(0.74, 0.56, noise)[..., None]
    )
    color = mix(color, light, 0.85 * cover[..., None])
    for layer, (top, amount, paint) in enumerate(
        (
            (0.958, 0.030, (0.70, 0.70, 0.72)),
            (0.975, 0.022, (0.56, 0.59, 0.52)),
            (0.990, 0.014, (0.45, 0.50, 0.33)),
        )
    ):
        ridge = top - amount * (value_noise((width, 1), (5 + 3 * layer, 1), 341 + layer)[0] - 0.5) * 2
        color = mix(color, np.array(paint), smoothstep(-0.002, 0.002, y - ridge)[..., None])
    return bytes_of(color)


def meadow(px: int) -> Bytes:
    """Return dry grass and bare earth seen from above, 1 repeat = 8 m."""
    tufts, bare = fbm(px, 32, 4, 351, 0.6), smoothstep(0.52, 0.72, fbm(px, 3, 5, 361, 0.6))
    color = mix(np.array([0.36, 0.42, 0.19]), np.array([0.52, 0.47, 0.30]), bare[..., None])
    return bytes_of(color * (0.72 + 0.56 * tufts[..., None]))


def garden(width: int, height: int) -> Bytes:
    """Return a view of hills, cypresses and a path in evening light: a picture that is already lit."""
    x, y = pixel_grid(width, height)
    haze = np.array([0.98, 0.84, 0.64])
    sky = mix(haze, np.array([0.50, 0.66, 0.84]), smoothstep(0.52, 0.0, y)[..., None])
    streaks = value_noise((width, height), (4, 24), 281) * smoothstep(0.5, 0.2, y)
    color = mix(sky, np.array([1.0, 0.93, 0.84]), (0.7 * smoothstep(0.55, 0.95, streaks))[..., None])
    for layer, (top, amount, paint) in enumerate(
        (
            (0.46, 0.10, (0.62, 0.62, 0.64)),
            (0.53, 0.09, (0.52, 0.55, 0.47)),
            (0.61, 0.07, (0.46, 0.50, 0.30)),
            (0.71, 0.05, (0.42, 0.46, 0.20)),
        )
    ):
        ridge = top - amount * (value_noise((width, 1), (5 + 2 * layer, 1), 291 + layer)[0] - 0.5) * 2
        inside = smoothstep(0.0, 0.004, y - ridge)
        shade = 0.92 + 0.3 * (value_noise((width, height), (32 << layer, 24), 301 + layer) - 0.5) * (
            0.3 + 0.2 * layer
        )
        color = mix(color, tint(paint, shade), inside[..., None])
        rng = np.random.default_rng(311 + layer)
        for foot in rng.uniform(0.02, 0.98, 2 + 3 * layer):
            color = _cypress(
                color,
                x,
                y,
                foot,
                ridge[int(foot * width)] + 0.02,
                0.05 + 0.045 * layer,
                layer,
                height / width,
            )
    path = np.abs(x - 0.5 - 0.10 * np.sin((y - 0.66) * 14.0)) < 0.015 + 0.22 * np.clip(y - 0.68, 0, 1)
    gravel = tint((0.84, 0.74, 0.58), 0.9 + 0.2 * value_noise((width, height), (96, 64), 321))
    return bytes_of(mix(color, gravel, (path & (y > 0.69))[..., None] * 0.9))


def _cypress(
    color: Float64, x: Float64, y: Float64, foot: float, ground: float, tall: float, layer: int, ratio: float
) -> Float64:
    """Paint one tree of height `tall` (of the picture's) with its foot at (`foot`, `ground`)."""
    up = (ground - y) / tall
    wide = 0.13 * tall * ratio * np.sqrt(np.clip(up + 0.05, 0, 1)) * np.clip(1.0 - up, 0, 1) * 2.2
    inside = (np.abs(x - foot) < wide) & (up > -0.05) & (up < 1)
    lit = smoothstep(-1.0, 1.0, (x - foot) / np.maximum(wide, 1e-6))
    near, far = np.array([0.13, 0.20, 0.10]), np.array([0.46, 0.50, 0.46])
    paint = mix(near, far, 1 - layer / 3) * (0.8 + 0.7 * lit[..., None])
    return np.where(inside[..., None], paint, color)
