"""The figure of automatic exposure: a picture in nits, its histogram, and the average between two percentiles."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas

Float64 = NDArray[np.float64]

SIZE = (48, 27)
LOW, HIGH, KEY = 0.50, 0.95, 0.18
"""The shares of the pixels between which the average is taken, and the picture value that it gets: the defaults."""
PER_STOP = 4


@cache
def picture() -> Float64:
    """Return luminances (H, W) in nits: a ball on a floor in the sun, in front of a wall in shade with a lamp."""
    width, height = SIZE
    px, py = np.meshgrid(
        (np.arange(width) + 0.5) / height - 0.5 * width / height, 0.5 - (np.arange(height) + 0.5) / height
    )
    way = np.stack([px, py - 0.12, np.full_like(px, -1.0)], axis=-1)
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    eye, sun = np.array([0.0, 1.0, 4.0]), np.array([0.5, 0.75, 0.45])
    sun /= np.linalg.norm(sun)
    sky = 5_000 * np.exp(-3 * np.clip(way[..., 1], 0, 1))
    centre, radius = np.array([-0.35, 0.55, 0.9]), 0.55
    along = way @ (centre - eye)
    under = along**2 - ((centre - eye) @ (centre - eye) - radius**2)
    ball = under > 0
    place = eye + (along - np.sqrt(np.maximum(under, 0)))[..., None] * way
    facing = np.clip(((place - centre) / radius) @ sun, 0, 1)
    found = np.where(ball, 0.45 * (60_000 * facing + 9_000) / np.pi, sky)
    with np.errstate(divide="ignore"):
        floor = np.where(way[..., 1] < 0, -eye[1] / way[..., 1], np.inf)
        wall = np.where(way[..., 0] > 0.02, (1.0 - eye[0]) / np.maximum(way[..., 0], 1e-9), np.inf)
    there = eye + np.where(np.isfinite(floor), floor, 0)[..., None] * way
    to_centre = centre - there
    near = to_centre @ sun
    shaded = ((to_centre**2).sum(axis=-1) - near**2 < radius**2) & (near > 0)
    pattern = np.where((np.floor(there[..., 0]) + np.floor(there[..., 2])) % 2 == 0, 0.5, 0.2)
    pattern = pattern * np.exp(
        0.3 * np.sin(3.1 * there[..., 0]) + 0.3 * np.sin(2.3 * there[..., 2])
    )  # not even
    lit = np.where(shaded, 4_000.0, 70_000.0)
    found = np.where(~ball & (floor < 30), pattern * lit / np.pi, found)
    at_wall = eye + np.where(np.isfinite(wall), wall, 0)[..., None] * way
    in_wall = ~ball & (wall < floor) & (at_wall[..., 1] < 2.2)
    found = np.where(in_wall, 120 * (1 + 0.8 * np.sin(4 * at_wall[..., 2])), found)
    lamp = in_wall & (np.hypot(at_wall[..., 1] - 1.4, at_wall[..., 2] - 1.6) < 0.16)
    return np.where(lamp, 250_000.0, found)


def log_average(nits: Float64, low: float, high: float) -> float:
    """Return the mean log2 luminance of the pixels between two shares, the darkest first; parts of pixels count."""
    values = np.sort(np.log2(nits.ravel()))
    number = np.arange(values.size)
    weights = np.clip(
        np.minimum(number + 1, high * values.size) - np.maximum(number, low * values.size), 0, None
    )
    return float((weights * values).sum() / weights.sum())


def histogram() -> Canvas:
    """A picture, the histogram of its log2 luminance with the two percentiles, and the exposure that follows."""
    c = Canvas(
        760, 330, "A histogram of log2 luminance, the pixels that count, and the exposure that follows"
    )
    nits = picture()
    mean = log_average(nits, LOW, HIGH)
    exposure = KEY / 2**mean
    shades = np.round(255 * np.clip(nits * exposure, 0, 1) ** (1 / 2.2)).astype(int)
    cell = 5.0
    for row, line in enumerate(shades.tolist()):
        start = 0
        for column in range(1, SIZE[0] + 1):
            if column == SIZE[0] or line[column] != line[start]:
                size = f'width="{cell * (column - start) + 0.3:g}" height="{cell + 0.3:g}"'
                place = f'x="{14 + cell * start:g}" y="{40 + cell * row:g}"'
                c.raw(f'<rect {place} {size} fill="#{3 * f"{line[start]:02x}"}"/>')
                start = column
    c.text(14, 26, "the picture at this exposure")
    c.note(14, 200, f"average: 2^{mean:.2f} = {2**mean:,.0f} nits")
    c.note(14, 220, f"exposure: {KEY:g} / {2**mean:,.0f} = {exposure:.2e}".replace("e-0", "e-"))
    c.note(14, 240, f"as EV100: {-math.log2(1.2 * exposure):.2f}")
    c.note(14, 270, f"The lamp of 2^{math.log2(nits.max()):.1f} nits is above")
    c.note(14, 288, f"{100 * HIGH:g} % of the pixels and does not count.")
    values = np.sort(np.log2(nits.ravel()))
    first, last = math.floor(values[0]), math.ceil(values[-1])
    counts, edges = np.histogram(values, np.arange(first * PER_STOP, last * PER_STOP + 1) / PER_STOP)
    low, high = (float(np.quantile(values, share)) for share in (LOW, HIGH))
    left, wide, bottom, tall = 318.0, 420.0, 250.0, 186.0

    def at(value: float) -> float:
        return left + wide * (value - first) / (last - first)

    for count, edge in zip(counts.tolist(), edges.tolist(), strict=False):
        for begin, end, fill in ((-99.0, low, "card"), (low, high, "b"), (high, 99.0, "card")):
            a, b = max(edge, begin), min(edge + 1 / PER_STOP, end)
            if count and a < b:
                tower = tall * count / counts.max()
                c.rectangle((at(a), bottom - tower, at(b) - at(a), tower), fill, "line", False, 0)
    c.line([(left, bottom), (left + wide, bottom)], "line", 1)
    for stop in range(first, last + 1, 2):
        c.line([(at(stop), bottom), (at(stop), bottom + 5)], "line", 1)
        c.text(at(stop), bottom + 18, f"{stop}", 11, "middle", "soft")
    c.note(left, bottom + 38, "log2 of luminance in nits; bars of a quarter of a stop")
    for value, words, anchor in ((low, f"{100 * LOW:g} %", "end"), (high, f"{100 * HIGH:g} %", "start")):
        c.line([(at(value), 36), (at(value), bottom)], "s1", 1.5, dashed=True)
        c.text(at(value) + (-5 if anchor == "end" else 5), 46, words, 12, anchor)
    c.line([(at(mean), 30), (at(mean), bottom)], "mark", 2)
    c.text(at(mean), 24, f"average {mean:.2f}", 12, "middle", "mark")
    c.note(left, 318, "yellow: the pixels between the percentiles, which count")
    return c
