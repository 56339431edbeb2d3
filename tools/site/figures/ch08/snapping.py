"""The loop of chapter 8: a shadow in the texels of a cascade while the camera moves, without and with whole texels."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from chapters.ch08.shadows.cascades import directional_faces
from tools.site.figures.ch08.cascades import ASPECT, BOX, CASCADES, EYE, GUARD, view
from tools.site.figures.film import Loop, Picture

Float64 = NDArray[np.float64]
Texels = frozenset[tuple[int, int]]

SIZE = 128
"""Texels of the cascade: so few that they are seen."""
FRAMES, PATH = 36, (1.7, 0.0, -1.1)
"""The camera goes a whole way forth and back, so that the loop has no seam: metres from its place at the end."""
UP = np.array([[0.0, -1.0, 0.0]])
EDGES, LONG = 12, 0.31
"""The caster: a square that is turned, its edge in texels and its turn in radians."""
AROUND, FINE = 9, 10
"""Texels of the window to each side, and points along each of them."""


def eye_at(number: int) -> tuple[float, float, float]:
    """Return the place of the camera in a frame."""
    part = 0.5 - 0.5 * np.cos(2 * np.pi * number / FRAMES)
    x, y, z = (float(a + part * b) for a, b in zip(EYE, PATH, strict=True))
    return x, y, z


@cache
def origin(number: int, snapped: bool) -> tuple[float, float, float]:
    """Return the middle of the first cascade along x and z, and its texels for each metre."""
    face = directional_faces(UP, BOX, view(eye_at(number)), np.zeros(3), ASPECT, CASCADES, SIZE, GUARD)[0]
    x, z, scale = float(face["origin"][0]), float(face["origin"][2]), float(face["scale_x"])
    if not snapped:  # the sphere's middle as it is: the first record's, moved with the camera
        first, begin = eye_at(0), origin(0, True)
        now = eye_at(number)
        x, z = begin[0] + now[0] - first[0], begin[1] + now[2] - first[2]
    return x, z, scale


def covered(number: int, snapped: bool) -> tuple[Texels, tuple[float, float]]:
    """Return the texels whose middle is in the caster, and the place of texel (0, 0), in texels of the world.

    Texels are counted from the place in the world of the first frame, so that equal places are equal numbers.
    """
    x, z, scale = origin(number, snapped)
    base = origin(0, True)
    moved = (x - base[0]) * scale, (z - base[1]) * scale
    whole = tuple(round(one) for one in moved)
    offset = moved[0] - whole[0], moved[1] - whole[1]
    around = np.arange(-AROUND, AROUND)
    px, pz = np.meshgrid(around + 0.5 + offset[0], around + 0.5 + offset[1])
    c, s = np.cos(LONG), np.sin(LONG)
    inside = (np.abs(c * px + s * pz) <= EDGES / 2) & (np.abs(c * pz - s * px) <= EDGES / 2)
    found = frozenset((int(i), int(j)) for j, i in np.argwhere(inside) - AROUND)
    return found, offset


@cache
def shape(number: int, snapped: bool) -> NDArray[np.bool_]:
    """Return whether points of the world, FINE for each edge of a texel, lie in the shadow of a frame."""
    texels, offset = covered(number, snapped)
    held = np.zeros((2 * AROUND + 2, 2 * AROUND + 2), bool)
    for i, j in texels:
        held[j + AROUND, i + AROUND] = True
    at = (np.arange(2 * (AROUND - 1) * FINE) + 0.5) / FINE + 1
    column, row = (np.floor(at - one).astype(int) for one in offset)
    return held[row[:, None], column[None, :]]


def changed(number: int, snapped: bool) -> float:
    """Return the area that is in the shadow in one of a frame and the frame before, and not in the other, in texels."""
    return float((shape(number, snapped) ^ shape((number - 1) % FRAMES, snapped)).sum()) / FINE**2


def snapping(c: Picture, number: int) -> None:
    """The shadow of a square in texels: on the left the map follows the camera, on the right in whole texels."""
    step = 14.0
    for left, snapped, title in (
        (16.0, False, "the map follows the camera"),
        (336.0, True, "in whole texels"),
    ):
        c.text(left, 24, title, 13, bold=True)
        texels, offset = covered(number, snapped)
        middle = left + 144.0, 178.0
        for i, j in sorted(texels):
            place = middle[0] + step * (i + offset[0]), middle[1] + step * (j + offset[1])
            c.rectangle((*place, step, step), "a", "s1", False, 0)
        cos, sin, half = np.cos(LONG), np.sin(LONG), EDGES / 2
        corners = [
            (cos * x - sin * y, sin * x + cos * y)
            for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))
        ]
        outline = [(middle[0] + step * float(x), middle[1] + step * float(y)) for x, y in corners]
        c.line([*outline, outline[0]], "mark", 2)
        c.note(left, 326, f"changed since the frame before: {changed(number, snapped):.0f} texels")


SNAPPING = {
    "ch08-snapping-loop": Loop(
        "A shadow in texels while the camera moves: its edge crawls, and with whole texels it stands still",
        "ch08-cascades.svg",
        (640, 340),
        FRAMES,
        snapping,
    )
}
