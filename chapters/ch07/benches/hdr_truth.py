"""Truths of exposure and bloom in double precision, from their definitions, and the pictures that they are tried on.

What the GPU counts in bins, averages in steps and stores in half precision is sorted, summed and filtered here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material, Sampler, Scene, TextureRef
from common.scene.primitive import scene_of
from common.view.camera import Orthographic, View

Float64 = NDArray[np.float64]

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
"""Of red, green and blue in luminance (BT.709)."""

DARKEST, BRIGHTEST = 2.0**-16, 2.0**20
"""Nits that the histogram tells apart: what lies outside counts as the end."""

LAMP_NITS = 1e6

ROUND = 1e-9
"""Part of a step that a closed form may be off by."""


# --- exposure ---------------------------------------------------------------------------------------------------------


def log2_average(nits: Float64, low: float, high: float) -> float:
    """Return the mean log2 of luminances (N,) between two shares of the pixels, by a sort of all of them."""
    stops = np.sort(np.log2(np.clip(nits.ravel(), DARKEST, BRIGHTEST)))
    sums = np.concatenate([[0.0], np.cumsum(stops)])  # up to each place; between two places it is a line
    ends = np.array([low, high]) * len(stops)
    below, above = np.interp(ends, np.arange(len(sums)), sums)
    return float((above - below) / (ends[1] - ends[0]))


def frames_by_histogram(stops: float, tau: float, step: float, part: float) -> int:
    """Return the frames until the exposure is within `part` of its target, where `stops` are missing that fall as
    exp(-t / tau); times in seconds.
    """
    within = -math.log2(1.0 - part) if stops > 0 else math.log2(1.0 + part)
    return _frames(abs(stops) / within, step / tau)


def frames_by_mips(before: float, target: float, speed: float, step: float, part: float) -> int:
    """Return the same, where the luminance itself goes from `before` to `target` by 0.98^speed in a millisecond."""
    within = target / (1.0 - part) - target if before > target else target - target / (1.0 + part)
    return _frames(abs(before - target) / within, -math.log(0.98) * speed * 1e3 * step)


def _frames(ratio: float, rate: float) -> int:
    """Return the least number n with ratio exp(-n rate) <= 1."""
    return max(0, math.ceil(math.log(max(ratio, 1e-300)) / rate - ROUND))


# --- bloom ------------------------------------------------------------------------------------------------------------


def bloomed(picture: Float64, strength: float, threshold: float, levels: int) -> Float64:
    """Return a picture (H, W, 3) in which a part of what is bright is spread: the mean of all levels of its pyramid."""
    peak = picture.max(axis=-1, keepdims=True)
    bright = picture * np.maximum(peak - threshold, 0.0) / np.where(peak > 0.0, peak, 1.0)
    pyramid = [bright]
    for level in range(1, levels + 1):
        height, width = (max(1, round(size / 2**level)) for size in picture.shape[:2])
        above = pyramid[-1]
        pyramid.append(_filtered(above, _halving(above.shape[0], height), _halving(above.shape[1], width)))
    spread = pyramid.pop()
    for count, level in enumerate(reversed(pyramid[1:]), start=1):
        spread = (count * _enlarged(spread, level) + level) / (count + 1)
    return np.asarray(picture + strength * (_enlarged(spread, bright) - bright))


def _filtered(image: Float64, rows: Float64, columns: Float64) -> Float64:
    """Return (I, J, C) sums over an image (H, W, C) with weights (I, H) and (J, W)."""
    return np.asarray(np.einsum("ih,hwc,jw->ijc", rows, image, columns, optimize=True))


def _enlarged(image: Float64, like: Float64) -> Float64:
    """Return an image at the size of another one, about twice its own."""
    return _filtered(image, *(_doubling(image.shape[axis], like.shape[axis]) for axis in (0, 1)))


def _halving(size: int, count: int) -> Float64:
    """Return weights (count, size): 1, 3, 3, 1 of 8, and at the ends those beyond fall to the last one."""
    weights = np.zeros((count, size))
    for tap, weight in enumerate((0.125, 0.375, 0.375, 0.125)):
        np.add.at(weights, (np.arange(count), np.clip(2 * np.arange(count) - 1 + tap, 0, size - 1)), weight)
    return weights


def _doubling(size: int, count: int) -> Float64:
    """Return weights (count, size): 3/4 for the nearest and 1/4 for the next one, on the side where the texel lies."""
    weights, fine = np.zeros((count, size)), np.arange(count)
    for place, weight in ((fine // 2, 0.75), (fine // 2 + np.where(fine % 2, 1, -1), 0.25)):
        np.add.at(weights, (fine, np.clip(place, 0, size - 1)), weight)
    return weights


# --- pictures ---------------------------------------------------------------------------------------------------------


def lamps(size: tuple[int, int], moved: int = 0) -> Float64:
    """Return (H, W, 3) nits: a dim picture with lamps of 2x2 pixels and LAMP_NITS, `moved` pixels to the right."""
    width, height = size
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, width), np.linspace(0.0, 1.0, height))
    dim = 2.0 ** (4.0 * np.sin(7.0 * x + 2.0 * y) + 3.0 * np.cos(5.0 * y))  # over 14 stops
    nits = dim[..., None] * np.array([1.0, 0.8, 0.6])
    for column, row in rng.uniform(0.3, 0.7, (5, 2)) * (width, height):
        nits[int(row) : int(row) + 2, int(column) + moved : int(column) + moved + 2] = LAMP_NITS
    return nits


def glowing(nits: Float64) -> Scene:
    """Return a black rectangle that glows as a picture (H, W, 3) says, pixel by pixel in the view `facing`."""
    height, width = nits.shape[:2]
    largest = float(nits.max())
    texels = np.concatenate([nits / largest, np.ones((height, width, 1))], axis=-1).astype(np.float32)
    nearest = Sampler("nearest", "nearest", None)
    material = Material(
        "picture",
        base_color=(0.0, 0.0, 0.0, 1.0),
        metallic=1.0,
        roughness=1.0,
        emissive=(largest,) * 3,
        emissive_texture=TextureRef(0, nearest),
    )
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float64)
    return scene_of(
        "lamps",
        np.column_stack([corners * (width / height, 1.0), np.zeros(4)]),
        np.tile((0.0, 0.0, 1.0), (4, 1)),
        0.5 + 0.5 * corners * (1.0, -1.0),
        np.array([0, 1, 2, 0, 2, 3]),
        material,
        [Image("picture", texels)],
    )


def facing(ev100: float) -> View:
    """Return the view that the rectangle fills."""
    return View(pose_looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), Orthographic(1.0, 0.1, 4.0), ev100=ev100)
