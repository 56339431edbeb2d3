"""The materials of the city, by name, and their pictures: most surfaces get their colour from the vertices.

Pictures of walls and grounds are near white, since a vertex colour is multiplied with them: one picture of bricks does
for red, brown and yellow houses.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from assets.gltf_writer import GltfBuilder, Texture
from assets.noise import (
    Bytes,
    Float64,
    bytes_of,
    fbm,
    mix,
    per_cell,
    pixel_grid,
    smoothstep,
    tint,
    value_noise,
)

LAMP_NITS, SIGN_NITS = 24000.0, 9000.0


def brick(px: int) -> Bytes:
    """Return courses of brick in mortar, 1 repeat = 2 m of 8 x 24 bricks."""
    x, y = pixel_grid(px)
    columns, rows = 8, 24
    row = np.floor(y * rows).astype(np.int64)
    along = x * columns + 0.5 * (row % 2)
    number = np.floor(along).astype(np.int64) % columns + columns * row
    across, down = along % 1.0, y * rows % 1.0
    joint = np.minimum(
        np.minimum(across, 1 - across) * (2.0 / columns), np.minimum(down, 1 - down) * (2.0 / rows)
    )
    inside = smoothstep(0.004, 0.012, joint)
    grain, stain = fbm(px, 32, 3, 501), fbm(px, 3, 5, 506)
    value = 0.62 + 0.3 * per_cell(number, 511) + 0.3 * (grain - 0.5) + 0.25 * (stain - 0.5)
    color = tint((1.0, 0.95, 0.9), value)
    mortar = tint((0.9, 0.88, 0.84), 0.86 + 0.3 * (grain - 0.5))
    return bytes_of(mix(mortar, color, inside[..., None]))


def plaster(px: int) -> Bytes:
    """Return rendered walls with faint stains that run down, 1 repeat = 4 m."""
    cloud, grain, runs = fbm(px, 3, 6, 521, 0.6), fbm(px, 48, 2, 531), fbm(px, (24, 2), 4, 541)
    value = 0.93 + 0.20 * (cloud - 0.5) + 0.06 * (grain - 0.5) + 0.16 * (runs - 0.5)
    return bytes_of(tint((1.0, 0.985, 0.96), value))


def ashlar(px: int) -> Bytes:
    """Return blocks of cut stone, 1 repeat = 2.4 m of 3 x 6 blocks."""
    x, y = pixel_grid(px)
    columns, rows = 3, 6
    row = np.floor(y * rows).astype(np.int64)
    along = x * columns + 0.5 * (row % 2)
    number = np.floor(along).astype(np.int64) % columns + columns * row
    across, down = along % 1.0, y * rows % 1.0
    joint = np.minimum(
        np.minimum(across, 1 - across) * (2.4 / columns), np.minimum(down, 1 - down) * (2.4 / rows)
    )
    grain, bed = fbm(px, 12, 5, 551, 0.6), fbm(px, (2, 24), 3, 561)
    value = 0.84 + 0.14 * per_cell(number, 571) + 0.2 * (grain - 0.5) + 0.1 * (bed - 0.5)
    return bytes_of(tint((1.0, 0.98, 0.95), value * mix(0.55, 1.0, smoothstep(0.006, 0.02, joint))))


def concrete(px: int) -> Bytes:
    """Return cast panels with joints and holes of their ties, 1 repeat = 3.6 m of 2 x 2 panels."""
    x, y = pixel_grid(px)
    across, down = x * 2 % 1.0, y * 2 % 1.0
    joint = np.minimum(np.minimum(across, 1 - across), np.minimum(down, 1 - down)) * 1.8
    ties = np.hypot(np.abs(across - 0.5) - 0.28, np.abs(down - 0.5) - 0.28) * 1.8
    panel = np.floor(x * 2).astype(np.int64) + 2 * np.floor(y * 2).astype(np.int64)
    cloud, grain = fbm(px, 4, 6, 581, 0.6), fbm(px, 64, 2, 591)
    value = 0.88 + 0.06 * per_cell(panel, 601) + 0.2 * (cloud - 0.5) + 0.08 * (grain - 0.5)
    value = (
        value * mix(0.6, 1.0, smoothstep(0.008, 0.02, joint)) * mix(0.55, 1.0, smoothstep(0.02, 0.035, ties))
    )
    return bytes_of(tint((1.0, 1.0, 0.99), value))


def asphalt(px: int) -> Bytes:
    """Return a road's surface with patches and cracks, 1 repeat = 4 m; bright, so that paint on it keeps its colour."""
    grain, cloud = fbm(px, 64, 2, 611, 0.8), fbm(px, 3, 5, 621, 0.6)
    crack = smoothstep(0.012, 0.0, np.abs(fbm(px, 3, 5, 631, 0.55) - 0.46)) * smoothstep(0.5, 0.62, cloud)
    value = 0.78 + 0.5 * (grain - 0.5) + 0.3 * (cloud - 0.5) - 0.3 * crack
    return bytes_of(tint((1.0, 1.0, 1.0), value))


def paving(px: int) -> Bytes:
    """Return slabs of a pavement, 1 repeat = 3 m of 4 x 6 slabs."""
    x, y = pixel_grid(px)
    row = np.floor(y * 6).astype(np.int64)
    along = x * 4 + 0.5 * (row % 2)
    number = np.floor(along).astype(np.int64) % 4 + 4 * row
    across, down = along % 1.0, y * 6 % 1.0
    joint = np.minimum(np.minimum(across, 1 - across) * 0.75, np.minimum(down, 1 - down) * 0.5)
    grain, dirt = fbm(px, 40, 3, 641), fbm(px, 4, 5, 651)
    value = 0.76 + 0.18 * per_cell(number, 661) + 0.22 * (grain - 0.5) + 0.22 * (dirt - 0.5)
    return bytes_of(tint((1.0, 0.985, 0.96), value * mix(0.55, 1.0, smoothstep(0.006, 0.018, joint))))


def grass(px: int) -> Bytes:
    """Return a mown lawn, 1 repeat = 6 m."""
    blades, patches = fbm(px, 48, 3, 671, 0.7), fbm(px, 3, 4, 681)
    color = mix(
        np.array([0.78, 0.86, 0.5]), np.array([0.95, 0.92, 0.66]), smoothstep(0.45, 0.7, patches)[..., None]
    )
    return bytes_of(color * (0.62 + 0.6 * blades[..., None]))


def tiles(px: int) -> Bytes:
    """Return flat tiles of a roof, v down the slope, 1 repeat = 1.8 m of 9 x 6 tiles."""
    x, y = pixel_grid(px)
    row = np.floor(y * 6).astype(np.int64)
    along = x * 9 + 0.5 * (row % 2)
    number = np.floor(along).astype(np.int64) % 9 + 9 * row
    across, down = along % 1.0, y * 6 % 1.0
    value = 0.72 + 0.3 * per_cell(number, 691) + 0.3 * (fbm(px, 12, 4, 701) - 0.5)
    value = value * mix(0.5, 1.0, smoothstep(0.0, 0.14, down)) * mix(0.7, 1.0, smoothstep(0.0, 0.08, across))
    return bytes_of(tint((1.0, 0.97, 0.95), value))


def panes(px: int) -> Bytes:
    """Return eight windows as the street sees them: sky in the glass, curtains, blinds, dark rooms; below with bars."""
    x, y = pixel_grid(px)
    across, down = x * 4 % 1.0, y * 4 % 1.0
    cell = (np.floor(x * 4).astype(np.int64) + 4 * np.floor(y * 4).astype(np.int64)) % 8
    cloud = value_noise((px, px), (14, 18), 711)
    blue = mix(
        np.array([0.30, 0.44, 0.58]),
        np.array([0.62, 0.70, 0.76]),
        (0.75 * down + 0.5 * (cloud - 0.5))[..., None],
    )
    room = mix(np.array([0.13, 0.17, 0.21]), np.array([0.26, 0.31, 0.36]), (1 - down)[..., None])
    glint = smoothstep(0.10, 0.0, np.abs(across - 0.7 + 0.4 * down)) * 0.10
    color = np.where(np.isin(cell, (0, 1))[..., None], blue, room)
    folds = 0.82 + 0.18 * np.sin(across * 75.0)
    drawn = np.where(cell == 2, np.abs(across - 0.5) > 0.16 + 0.16 * down, np.abs(across - 0.5) > 0.34)
    drawn &= (cell == 2) | (cell == 3)
    color = np.where(drawn[..., None], tint((0.80, 0.76, 0.66), folds), color)
    slats = 0.72 + 0.2 * np.abs(down * 22 % 1.0 * 2 - 1)
    lowered = ((cell == 4) & (down < 0.78)) | ((cell == 5) & (down < 0.36))
    color = np.where(lowered[..., None], tint((0.86, 0.83, 0.76), slats), color)
    bars = np.minimum(np.abs(across - 0.5), np.minimum(np.abs(down - 0.42), 0.5 - np.abs(across - 0.5)))
    bars = np.minimum(bars, 0.5 - np.abs(down - 0.5))
    painted = (bars < np.where(0.5 - np.abs(across - 0.5) < 0.07, 0.07, 0.028)) & (y > 0.5)
    return bytes_of(np.where(painted[..., None], (0.72, 0.71, 0.67), color + glint[..., None]))


def railing(px: int) -> Bytes:
    """Return iron bars with scrolls between two rails, with alpha for a mask, 1 repeat = 2 m of 1 m height."""
    x, y = pixel_grid(px * 2, px)
    across = np.abs(x * 16 % 1.0 * 2 - 1)
    ring = np.abs(np.hypot((x * 8 % 1.0 * 2 - 1) * 0.125, (y - 0.2) * 1.0) - 0.085)
    bars = (across > 0.84) & (y > 0.02)
    rails = (y < 0.05) | (np.abs(y - 0.34) < 0.02) | (y > 0.93)
    alpha = np.where(bars & (y > 0.34) | rails | (ring < 0.018), 1.0, 0.0)
    color = np.broadcast_to([0.09, 0.09, 0.10], (*alpha.shape, 3))
    return bytes_of(np.concatenate([color, alpha[..., None]], -1))


def leaves(px: int) -> Bytes:
    """Return a spray of small leaves, densest in its middle, with alpha for a mask.

    Colour goes on outside the mask: filtering then never mixes in a dark fringe.
    """
    x, y = pixel_grid(px)
    color = np.broadcast_to([0.26, 0.38, 0.13], (px, px, 3))
    alpha = np.zeros((px, px))
    rng = np.random.default_rng(731)
    for k in range(64):
        around, far = 2.399963 * k, 0.41 * np.sqrt((k + 0.5) / 64)
        dx, dy = x - 0.5 - far * np.cos(around), y - 0.5 - far * np.sin(around)
        turn = around + rng.uniform(-1.2, 1.2)
        along = dx * np.cos(turn) + dy * np.sin(turn)
        side = np.abs(dy * np.cos(turn) - dx * np.sin(turn))
        inside = side < 0.042 * np.clip(1.0 - (along / 0.085) ** 2, 0.0, 1.0)
        shade = rng.uniform(0.7, 1.2) * (0.88 + 0.25 * (side < 0.007))
        color = np.where(inside[..., None], tint((0.29, 0.45, 0.14), shade), color)
        alpha = np.where(inside, 1.0, alpha)
    return bytes_of(np.concatenate([color, alpha[..., None]], -1))


def sky(width: int, height: int) -> Bytes:
    """Return half the round of an afternoon sky, zenith on top, with far roofs in haze at the horizon."""
    x, y = pixel_grid(width, height)
    color: Float64 = mix(
        np.array([0.22, 0.43, 0.76]), np.array([0.62, 0.76, 0.88]), smoothstep(0.05, 0.8, y)[..., None]
    )
    color = mix(color, np.array([0.86, 0.88, 0.86]), smoothstep(0.75, 1.0, y)[..., None])
    # Clouds lie on a plane: what is one row of their noise there gets thinner towards the horizon.
    far = np.log(1.0 / np.tan(np.radians(90.0 * np.clip(1.0 - y[:, 0], 0.02, 0.98))))
    rows = np.clip((far + 3.0) / 6.5 * (width // 2), 0, width // 2 - 1).astype(np.int64)
    noise = fbm(width // 2, (7, 9), 6, 331, 0.55)[rows].repeat(2, axis=1)
    noise = 0.5 * (noise + np.roll(noise, 1, axis=1))
    cover = smoothstep(0.50, 0.70, noise) * smoothstep(0.04, 0.25, y) * smoothstep(0.98, 0.82, y)
    light = mix(
        np.array([0.80, 0.80, 0.83]), np.array([1.0, 0.99, 0.96]), smoothstep(0.76, 0.54, noise)[..., None]
    )
    color = mix(color, light, 0.85 * cover[..., None])
    for layer, (count, low, tall, paint) in enumerate(
        ((140, 0.978, 0.022, (0.70, 0.77, 0.82)), (96, 0.988, 0.018, (0.58, 0.65, 0.71)))
    ):
        block = np.floor(x[0] * count).astype(np.int64)
        top = low - tall * np.random.default_rng(721 + layer).random(count)[block] ** 2
        color = np.where((y > top)[..., None], paint, color)
    return bytes_of(color)


PICTURES: dict[str, tuple[Callable[..., Bytes], tuple[int, ...]]] = {
    "brick": (brick, (256,)),
    "plaster": (plaster, (256,)),
    "ashlar": (ashlar, (256,)),
    "concrete": (concrete, (256,)),
    "asphalt": (asphalt, (256,)),
    "paving": (paving, (256,)),
    "grass": (grass, (256,)),
    "tiles": (tiles, (256,)),
    "window": (panes, (512,)),
    "railing": (railing, (128,)),
    "leaves": (leaves, (128,)),
    "sky": (sky, (1024, 512)),
}


def add_materials(scene: GltfBuilder) -> dict[str, int]:
    """Add all materials and return their indices by name."""
    image = {name: scene.add_image(name, make(*sizes)) for name, (make, sizes) in PICTURES.items()}
    material: dict[str, int] = {}

    def add(name: str, picture: str | None = None, **values: Any) -> None:
        base = None if picture is None else Texture(image[picture])
        material[name] = scene.add_material(name, base=base, **values)

    for name, roughness in (
        ("brick", 0.9), ("plaster", 0.9), ("ashlar", 0.85), ("concrete", 0.8),
        ("asphalt", 0.9), ("paving", 0.85), ("grass", 1.0), ("tiles", 0.75),
    ):  # fmt: skip
        add(name, name, roughness=roughness)
    add("painted", roughness=0.65)
    add("car_paint", roughness=0.28)
    add("metal", metallic=1.0, roughness=0.42)
    add("window", "window", roughness=0.12)
    add("bark", roughness=0.95)
    add("cloth", roughness=0.95, double_sided=True)
    add("foliage", roughness=1.0, double_sided=True)
    add("leaves", "leaves", roughness=1.0, alpha="MASK", double_sided=True)
    add("railing", "railing", roughness=0.5, alpha="MASK", double_sided=True)
    add("glass", color=(0.55, 0.68, 0.72, 0.22), roughness=0.05, alpha="BLEND")
    add("water", color=(0.06, 0.17, 0.19, 0.6), roughness=0.08, alpha="BLEND")
    add("lamp", color=(0.5, 0.5, 0.45), emissive_nits=(LAMP_NITS, LAMP_NITS * 0.82, LAMP_NITS * 0.55))
    add("sign", roughness=0.5, emissive_nits=(SIGN_NITS * 0.6, SIGN_NITS * 0.45, SIGN_NITS * 0.3))
    add("sky", "sky", unlit=True)
    return material
