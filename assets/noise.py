"""Tileable noise and the steps from heights and colours to the bytes of a texture.

Pictures are (H, W) or (H, W, C) float64 with row 0 on top; x runs with u to the right and y with v downwards, both in
0..1. All of it is arithmetic on seeded random lattices, so that every processor makes the same pixels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Bytes = NDArray[np.uint8]


def pixel_grid(width: int, height: int | None = None) -> tuple[Float64, Float64]:
    """Return x and y (H, W) of the pixel centres in 0..1."""
    height = height or width
    x = (np.arange(width) + 0.5) / width
    y = (np.arange(height) + 0.5) / height
    return np.broadcast_to(x, (height, width)), np.broadcast_to(y[:, None], (height, width))


def smoothstep(low: float, high: float, x: Float64) -> Float64:
    """Return the cubic that rises from 0 at `low` to 1 at `high`; `low` may be the larger one."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(a: NDArray[Any] | float, b: NDArray[Any] | float, t: NDArray[Any] | float) -> Float64:
    """Return the straight line from `a` at t = 0 to `b` at t = 1."""
    return np.asarray(a + (b - a) * t, np.float64)


def tint(color: tuple[float, float, float], amount: Float64) -> Float64:
    """Return (H, W, 3): `color` times a picture (H, W)."""
    return np.asarray(color) * amount[..., None]


def value_noise(size: tuple[int, int], cells: tuple[int, int], seed: int) -> Float64:
    """Return (H, W) smooth noise in 0..1 that repeats at the borders; `size` and `cells` are (W, H)."""
    lattice = np.random.default_rng(seed).random((cells[1], cells[0]))
    for axis, (pixels, count) in enumerate(((size[1], cells[1]), (size[0], cells[0]))):
        position = (np.arange(pixels) + 0.5) * count / pixels
        whole = np.floor(position).astype(np.int64)
        t = position - whole
        t = t * t * t * (t * (t * 6 - 15) + 10)
        t = t[:, None] if axis == 0 else t[None, :]
        near, far = lattice.take(whole % count, axis), lattice.take((whole + 1) % count, axis)
        lattice = near + (far - near) * t
    return lattice


def fbm(size: int, cells: int | tuple[int, int], octaves: int, seed: int, gain: float = 0.5) -> Float64:
    """Return (size, size) noise in 0..1, mean one half: octaves of value noise, each finer and fainter by `gain`."""
    cx, cy = (cells, cells) if isinstance(cells, int) else cells
    total, weight = np.zeros((size, size)), 0.0
    for octave in range(octaves):
        factor = gain**octave
        total += factor * value_noise((size, size), (cx << octave, cy << octave), seed + octave)
        weight += factor
    return total / weight


def per_cell(index: NDArray[np.int64], seed: int) -> Float64:
    """Return a random number in 0..1 for each integer >= 0, the same wherever the integer is the same."""
    return np.random.default_rng(seed).random(int(index.max()) + 1)[index]


def bytes_of(values: Float64) -> NDArray[np.uint8]:
    """Return 0..1 as bytes. Another processor's last bit moves a byte by one at most."""
    return np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def normal_map(height: Float64, strength: float) -> NDArray[np.uint8]:
    """Return the tangent-space normals of a tileable height field (H, W) as bytes, +y up as in glTF.

    `strength` is height over the width of the picture: how steep a step of 1 across the whole width is.
    """
    rows, columns = height.shape
    slope_right = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * (strength * columns / 2)
    slope_down = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * (strength * rows / 2)
    normal = np.stack([-slope_right, slope_down, np.ones_like(height)], -1)
    normal /= np.sqrt((normal * normal).sum(-1, keepdims=True))
    return bytes_of(normal * 0.5 + 0.5)


def surface_map(occlusion: Float64, roughness: Float64, metallic: Float64 | float) -> NDArray[np.uint8]:
    """Return occlusion, roughness and metalness in red, green and blue, as glTF packs them."""
    channels = np.broadcast_arrays(occlusion, roughness, np.asarray(metallic, np.float64))
    return bytes_of(np.stack(channels, -1))
