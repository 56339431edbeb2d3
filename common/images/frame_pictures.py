"""Pictures of what passes write: each kind of quantity by the mapping that shows it best, and which one that is.

A quantity is known by its format and by its name: depth becomes distance, ids get a hue, light is shown as the screen
would, normals and motion are centred on grey. Whatever is NaN or infinite is magenta.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.images import palette
from common.images.color import encode_srgb, quantize
from common.view.camera import Orthographic, View

TINY = 1e-30
"""Metres: what is nearer, or behind the camera of an orthographic view, counts as this."""

Picture = tuple[NDArray[np.uint8], str]
"""(H, W, 3) codes as shown, and how the values became them."""


def picture_of(values: NDArray[Any], name: str, format: str, view: View, stored: str = "light") -> Picture:
    """Return the picture of an image (H, W), (H, W, C) or (D, H, W, C) of `format`, which passes call `name`.

    `stored` is what colours hold in the frame of a view: "light", "value" (codes already) or "count".
    """
    if values.ndim == 4:
        return of_volume(values)
    if format.startswith("d"):
        return of_depth(values, view)
    if "normal" in name and format == "r32ui":
        return of_directions(from_octahedral(values))
    if format.endswith("ui"):
        return of_ids(joined(values))
    if values.dtype == np.uint8:
        return _codes(_channels(values) / 255.0), "as stored: codes that a screen shows"
    if "normal" in name:
        return of_directions(2 * values - 1 if format == "rgb10a2" else values)
    if "motion" in name:
        return of_motion(values)
    if "color" in name and stored != "light":
        return of_counts(values) if stored == "count" else of_values(values)
    if "color" in name or values.ndim == 3:
        return of_light(values)
    return of_numbers(values)


def of_volume(values: NDArray[Any]) -> Picture:
    """Return the slices of a 3D image (D, H, W, C) as a sheet, row by row; 1 is the largest number of all."""
    slices, height, width, channels = values.shape
    columns = math.ceil(math.sqrt(slices))
    rows = -(-slices // columns)
    sheet = np.zeros((rows * columns, height, width, channels))
    sheet[:slices] = values
    sheet = sheet.reshape(rows, columns, height, width, channels).swapaxes(1, 2)
    finite = np.abs(values[np.isfinite(values)])
    most = float(finite.max()) if finite.size and finite.max() > 0 else 1.0
    shown, text = of_light(sheet.reshape(rows * height, columns * width, channels) / most)
    return shown, f"{slices} slices in rows of {columns}, divided by {most:.3g}; {text}"


def of_depth(depth: NDArray[Any], view: View) -> Picture:
    """Return reversed depth (H, W) as distance ahead of the camera, the nearest white and the farthest a tenth of it.

    Between them equal ratios of distance are equal steps of grey: a room keeps its contrast under a sky far away.
    """
    values = np.asarray(depth, np.float64)
    z = np.maximum(distance(values, view), TINY)
    drawn, broken = np.isfinite(z) & (values > 0), ~np.isfinite(values)
    near, far = (float(z[drawn].min()), float(z[drawn].max())) if drawn.any() else (1.0, 1.0)
    ratio = np.log(np.where(drawn, z, near) / near) / (np.log(far / near) or 1.0)
    shown = np.repeat(np.where(drawn, 1.0 - 0.9 * ratio, 0.0)[..., None], 3, axis=-1)
    text = f"distance from white at {near:.3g} m to dark at {far:.3g} m" if drawn.any() else "nothing drawn"
    return _codes(shown, broken), text + _count(broken)


def distance(depth: NDArray[Any], view: View) -> NDArray[np.float64]:
    """Return the distance ahead of the camera, metres, of reversed depth; infinite for 0 in a perspective view."""
    reversed_depth = np.asarray(depth, np.float64)
    projection = view.projection
    if isinstance(projection, Orthographic):
        return projection.far - reversed_depth * (projection.far - projection.near)
    with np.errstate(divide="ignore"):
        return projection.near / reversed_depth


def from_octahedral(words: NDArray[Any]) -> NDArray[np.float64]:
    """Return unit vectors (H, W, 3) of octahedral codes (octahedral.glsl): two signed 16-bit numbers in a word."""
    halves = np.stack([words & 0xFFFF, words >> 16], axis=-1).astype(np.uint16).view(np.int16)
    code = np.maximum(halves / 32767.0, -1.0)
    vectors = np.concatenate([code, 1.0 - np.abs(code).sum(axis=-1, keepdims=True)], axis=-1)
    below = np.maximum(-vectors[..., 2:], 0.0)
    vectors[..., :2] -= np.where(vectors[..., :2] >= 0.0, below, -below)
    directions: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return directions


def joined(ids: NDArray[Any]) -> NDArray[Any]:
    """Return one id (H, W) of each pixel: of several words, a number that depends on all; 0 where the first is 0."""
    if ids.ndim == 2:
        return ids
    mixed = ids[..., 0].astype(np.uint32)
    for word in range(1, ids.shape[-1]):
        mixed = np.where(
            ids[..., 0] == 0, 0, (mixed * np.uint32(2654435761)) ^ ids[..., word].astype(np.uint32)
        )
    return mixed


def of_ids(ids: NDArray[Any]) -> Picture:
    """Return ids (H, W) as colours drawn by lot; 0, which stands for nothing, is black."""
    shown = palette.id_color(ids) * (np.asarray(ids) != 0)[..., None]
    count = len(np.unique(np.asarray(ids)[np.asarray(ids) != 0]))
    return _codes(shown), f"a hue for each id; {count} of them, black is none"


def of_directions(vectors: NDArray[Any]) -> Picture:
    """Return vectors (H, W, 3+) with components from -1 to 1 as 0.5 + 0.5 v."""
    rows = _channels(vectors)
    broken = _broken(rows)
    return _codes(0.5 + 0.5 * np.where(broken[..., None], 0.0, rows), broken), (
        f"directions: x, y, z from -1 to 1 as red, green, blue{_count(broken)}"
    )


def of_motion(vectors: NDArray[Any]) -> Picture:
    """Return motion (H, W, 2+) around grey, the largest component at the end of the scale."""
    rows = _channels(vectors)
    broken = _broken(rows)
    fine = np.where(broken[..., None], 0.0, rows)
    largest = float(np.abs(fine).max(initial=0.0))
    return _codes(0.5 + 0.5 * fine / (largest or 1.0), broken), (
        f"motion in x and y as red and green around grey; at most {largest:.3g}{_count(broken)}"
    )


def of_light(light: NDArray[Any]) -> Picture:
    """Return linear, pre-exposed light (H, W, 3+) in sRGB codes, without a tone curve."""
    rows = _channels(light)
    broken = _broken(rows)
    fine = np.where(broken[..., None], 0.0, rows)
    over = float((fine.max(axis=-1) > 1.0).mean())
    text = f"light at the frame's exposure, cut at white: {over:.1%} is brighter, at most {fine.max(initial=0.0):.4g}"
    return _codes(encode_srgb(np.clip(fine, 0.0, 1.0)), broken), text + _count(broken)


def of_values(values: NDArray[Any]) -> Picture:
    """Return the values of a view (H, W, 3+), from 0 to 1, as they are."""
    rows = _channels(values)
    broken = _broken(rows)
    return _codes(
        np.where(broken[..., None], 0.0, rows), broken
    ), f"the view's values as they are{_count(broken)}"


def of_counts(values: NDArray[Any]) -> Picture:
    """Return the counts of a view, in the first channel of (H, W, 3+), as heat from 0 to the largest."""
    rows = _channels(values)
    broken = _broken(rows)
    counts = np.where(broken, 0.0, rows[..., 0])
    largest = float(counts.max(initial=0.0))
    return _codes(palette.heat(counts / (largest or 1.0)), broken), (
        f"the view's counts, black 0 to white {largest:.3g}{_count(broken)}"
    )


def of_numbers(values: NDArray[Any]) -> Picture:
    """Return numbers (H, W) as grey from the least to the largest."""
    rows = np.asarray(values, np.float64)
    broken = ~np.isfinite(rows)
    fine = rows[~broken]
    low, high = (float(fine.min()), float(fine.max())) if fine.size else (0.0, 0.0)
    grey = (np.where(broken, low, rows) - low) / ((high - low) or 1.0)
    shown = np.repeat(grey[..., None], 3, axis=-1)
    return _codes(shown, broken), f"black {low:.4g}, white {high:.4g}{_count(broken)}"


def _channels(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the first three channels as float64; missing ones are 0, a single one is grey."""
    rows = np.asarray(values, np.float64)
    if rows.ndim == 2:
        return np.repeat(rows[..., None], 3, axis=-1)
    rows = rows[..., :3]
    return np.pad(rows, ((0, 0), (0, 0), (0, 3 - rows.shape[-1])))


def _broken(rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (H, W) bool: where some channel of `rows` (H, W, 3) is NaN or infinite."""
    return np.asarray(np.any(~np.isfinite(rows), axis=-1), np.bool_)


def _codes(shown: NDArray[Any], broken: NDArray[Any] | None = None) -> NDArray[np.uint8]:
    """Return colours from 0 to 1 as bytes, magenta where `broken` (H, W)."""
    if broken is not None:
        shown = np.where(broken[..., None], palette.MAGENTA, shown)
    return np.asarray(quantize(np.clip(shown, 0.0, 1.0)), np.uint8)


def _count(broken: NDArray[Any]) -> str:
    number = int(broken.sum())
    return f"; {number} pixels are NaN or infinite (magenta)" if number else ""
