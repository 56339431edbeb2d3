"""The materials of the night market, by name, and their pictures: paving, fabric, lit windows, lamps, a sky."""

from __future__ import annotations

from typing import Any

import numpy as np

from assets import city_materials as city
from assets.gltf_writer import GltfBuilder, Texture
from assets.market_plan import COLORS
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
from assets.textures import Maps, floor_tiles, wood

LAMP_NITS = {"bulb": 60.0, "shade": 8.0, "head": 120.0}
"""Luminance of bulbs, of shades and globes, and of the heads of poles, in nits where its picture is white."""

WINDOW_NITS, SIGN_NITS = 18.0, 8.0
PAVING_METRES, FABRIC_METRES, FLOOR_METRES = 2.4, 0.5, 2.4
"""What one repeat of a picture covers."""


def setts(px: int) -> Maps:
    """Return rounded paving stones with puddles between and on them, 1 repeat = 2.4 m of 16 x 16 stones."""
    x, y = pixel_grid(px)
    count = 16
    row = np.floor(y * count).astype(np.int64)
    along = x * count + 0.5 * (row % 2) + 0.12 * (per_cell(row, 801) - 0.5)
    number = np.floor(along).astype(np.int64) % count + count * row
    across, down = np.abs(along % 1.0 * 2 - 1), np.abs(y * count % 1.0 * 2 - 1)
    edge = np.maximum(across, down) + 0.25 * np.minimum(across, down) ** 3
    stone = smoothstep(1.02, 0.84, edge)
    dome = np.clip(1.0 - 0.45 * (across**2 + down**2), 0.0, 1.0)
    grain, damp = fbm(px, 48, 3, 811), fbm(px, 2, 5, 821, 0.55)
    each = per_cell(number, 831)
    puddle = smoothstep(0.56, 0.66, damp)
    height = mix(
        0.25 + 0.5 * stone * (0.55 + 0.45 * dome) + 0.2 * each * stone + 0.06 * grain, 0.62, 0.8 * puddle
    )
    value = (0.46 + 0.16 * each + 0.2 * (grain - 0.5)) * mix(0.45, 1.0, stone) * mix(1.0, 0.75, puddle)
    rough = mix(0.92, 0.42 + 0.3 * each + 0.2 * (grain - 0.5), stone)
    return Maps(
        bytes_of(tint((1.0, 0.96, 0.92), value)),
        normal_map(height, 0.011),
        surface_map(mix(0.55, 1.0, stone), mix(rough, 0.14, puddle), 0.0),
    )


def fabric(px: int) -> Maps:
    """Return canvas for a vertex colour to dye, 1 repeat = 0.5 m: a weave, faint folds and stains."""
    x, y = pixel_grid(px)
    threads = 40
    warp, weft = np.abs(x * threads % 1.0 * 2 - 1), np.abs(y * threads % 1.0 * 2 - 1)
    over = (np.floor(x * threads) + np.floor(y * threads)) % 2
    weave = np.where(over > 0, 1 - warp, 1 - weft)
    folds, stain = fbm(px, (6, 1), 3, 841), fbm(px, 3, 4, 851)
    value = 0.82 + 0.12 * weave + 0.2 * (stain - 0.5)
    return Maps(
        bytes_of(tint((1.0, 1.0, 1.0), value)),
        normal_map(0.25 * weave + 2.2 * folds, 0.012),
        surface_map(0.8 + 0.2 * weave, np.full_like(weave, 0.9), 0.0),
    )


def night_windows(px: int) -> tuple[Bytes, Bytes]:
    """Return the city's windows at night: their dark base colour, and which of them are lit how brightly."""
    day = city.panes(px).astype(np.float64) / 255.0
    x, y = pixel_grid(px)
    across, down = x * 4 % 1.0, y * 4 % 1.0
    cell = (np.floor(x * 4).astype(np.int64) + 4 * np.floor(y * 4).astype(np.int64)) % 8
    lit = np.array([0.0, 0.0, 0.9, 1.0, 0.55, 0.8, 0.0, 0.14])[cell]
    near = mix(1.0, 0.45, np.hypot(across - 0.5, 1.2 * (down - 0.35)))
    base = day * np.where(lit > 0.3, 0.7, 0.28)[..., None]
    glow = np.where(cell == 3, 0.75, 0.9)[..., None] * day * (lit * near)[..., None]
    return bytes_of(base), bytes_of(glow * np.array([1.0, 0.82, 0.55]))


def lamp_picture(width: int, height: int) -> Bytes:
    """Return a lamp's shade from its stem (top eighth, dark) to its foot: paper between ribs."""
    x, y = pixel_grid(width, height)
    inside = (y - 0.125) / 0.875
    ribs = mix(0.72, 1.0, smoothstep(0.0, 0.35, np.abs(inside * 9 % 1.0 * 2 - 1)))
    seams = mix(0.85, 1.0, smoothstep(0.0, 0.18, np.abs(x * 8 % 1.0 * 2 - 1)))
    middle = mix(0.5, 1.0, smoothstep(0.62, 0.1, np.abs(inside - 0.55)))
    value = ribs * seams * middle
    value = np.where((inside < 0.07) | (inside > 0.965), 0.03, value)
    return bytes_of(tint((1.0, 1.0, 1.0), np.where(y < 0.125, 0.02, value)))


def night_sky(width: int, height: int) -> Bytes:
    """Return half the round of a night sky, zenith on top: stars, thin clouds, the glow of a town."""
    _, y = pixel_grid(width, height)
    color = mix(
        np.array([0.035, 0.05, 0.11]), np.array([0.10, 0.11, 0.19]), smoothstep(0.2, 0.85, y)[..., None]
    )
    color = mix(color, np.array([0.26, 0.19, 0.17]), smoothstep(0.72, 1.0, y)[..., None])
    noise = fbm(width, (5, 9), 5, 861, 0.55)[:height]
    cloud = smoothstep(0.5, 0.72, noise) * smoothstep(0.1, 0.5, y)
    color = mix(color, np.array([0.20, 0.18, 0.22]), 0.5 * cloud[..., None])
    rng = np.random.default_rng(871)
    sparks = np.zeros((height, width))
    for _ in range(420):
        row, column = int(rng.integers(9 * height // 10)), int(rng.integers(width))
        sparks[row, column] = rng.uniform(0.15, 0.75)
    color = color + (sparks * (1.0 - cloud) * smoothstep(0.95, 0.6, y))[..., None] * np.array(
        [0.9, 0.95, 1.0]
    )
    for layer, (count, low, tall) in enumerate(((90, 0.985, 0.05), (60, 0.995, 0.035))):
        block = np.floor((np.arange(width) + 0.5) / width * count).astype(np.int64)
        top = low - tall * np.random.default_rng(881 + layer).random(count)[block] ** 2
        color = np.where((y > top)[..., None], np.array([0.05, 0.045, 0.06]) * (1.4 - 0.4 * layer), color)
    return bytes_of(color)


def add_materials(scene: GltfBuilder) -> dict[str, int]:
    """Add all materials and return their indices by name."""
    material: dict[str, int] = {}

    def picture(name: str, pixels: Bytes) -> Texture:
        return Texture(scene.add_image(name, pixels))

    def relief(name: str, maps: Maps, **values: Any) -> None:
        """Add a material with all three pictures of `maps`."""
        surface = picture(f"{name}_surface", maps.surface)
        material[name] = scene.add_material(
            name, base=picture(f"{name}_color", maps.base), surface=surface, occlusion=surface,
            normal=picture(f"{name}_normal", maps.normal), **values,
        )  # fmt: skip

    relief("setts", setts(512))
    relief("floor", floor_tiles(256), color=(0.5, 0.53, 0.56))
    relief("wood", wood(256))
    relief("awning", fabric(256), double_sided=True)
    for name, make, roughness in (
        ("brick", city.brick, 0.9), ("plaster", city.plaster, 0.9),
        ("ashlar", city.ashlar, 0.85), ("concrete", city.concrete, 0.8),
    ):  # fmt: skip
        material[name] = scene.add_material(name, base=picture(name, make(256)), roughness=roughness)
    base, glow = night_windows(256)
    material["window"] = scene.add_material(
        "window", base=picture("window", base), emission=picture("window_glow", glow), roughness=0.12,
        emissive_nits=(WINDOW_NITS, WINDOW_NITS, WINDOW_NITS),
    )  # fmt: skip
    material["railing"] = scene.add_material(
        "railing", base=picture("railing", city.railing(128)), roughness=0.5, alpha="MASK", double_sided=True
    )
    for name, values in _PLAIN.items():
        material[name] = scene.add_material(name, **values)
    shade = picture("lamp", lamp_picture(64, 128))
    kinds = {"string": LAMP_NITS["bulb"], "shade": LAMP_NITS["shade"]}
    for name, nits in kinds.items():
        for number, (r, g, b) in enumerate(COLORS):
            if name == "string" and number > 3:
                continue  # bulbs in the colours of shades are as bright as these
            material[f"{name}_{number}"] = scene.add_material(
                f"{name}_{number}", color=(0.3 * r, 0.3 * g, 0.3 * b), base=shade, emission=shade, roughness=0.7,
                emissive_nits=(nits * r, nits * g, nits * b),
            )  # fmt: skip
    head = LAMP_NITS["head"]
    material["head"] = scene.add_material("head", emissive_nits=(head, 0.8 * head, 0.55 * head))
    material["sky"] = scene.add_material("sky", base=picture("sky", night_sky(512, 256)), unlit=True)
    return material


_PLAIN: dict[str, dict[str, Any]] = {
    "painted": {"roughness": 0.6},
    "wares": {"roughness": 0.38},
    "metal": {"metallic": 1.0, "roughness": 0.3},
    "cloth": {"roughness": 0.95, "double_sided": True},
    "sign": {"roughness": 0.5, "emissive_nits": (SIGN_NITS * 0.6, SIGN_NITS * 0.42, SIGN_NITS * 0.22)},
    "glass": {"color": (0.95, 0.97, 1.0, 0.42), "roughness": 0.06, "alpha": "BLEND"},
    "pane": {"color": (0.95, 0.97, 1.0, 0.3), "roughness": 0.04, "alpha": "BLEND", "double_sided": True},
    "water": {"color": (0.05, 0.12, 0.15, 0.6), "roughness": 0.06, "alpha": "BLEND"},
}
"""Materials without pictures; most get their colour from the vertices."""
