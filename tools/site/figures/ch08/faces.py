"""The six faces of a point light as maps, with their axes; and the texels of one face from the side."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from chapters.ch08.scene.packing import LIGHT, LIGHT_KINDS
from chapters.ch08.shadows.faces import local_faces
from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")
SIZE, GUARD = 256, 2
FLOOR, HALF = -1.2, 4
"""Height of the floor below the lamp, and half of its edge, in metres."""
CRATE = np.array([(-0.3, FLOOR, -1.9), (0.7, -0.5, -1.0)])
"""Two corners of a crate on the floor, seen by two faces."""


def lamp_faces() -> np.ndarray:
    """Return the six FACE records of a lamp at the origin, as the chapter makes them."""
    lights = np.zeros(1, LIGHT)
    lights["kind"], lights["direction"] = LIGHT_KINDS["point"], (0, 0, -1)
    made, *_ = local_faces(lights, np.array([0]), np.array([SIZE]), 0.01, np.array([10.0]), np.array([GUARD]))
    return made


def seen(face: np.ndarray, points: Float64) -> Float64:
    """Return (N, 2) texels of `points` (N, 3) in a face over its size, NaN where they are behind it or outside."""
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    p = points @ axes.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = p[:, :2] * float(face["scale_x"]) / p[:, 2:] / float(face["size"]) + 0.5
    at[(p[:, 2] <= 1e-6) | (at < 0).any(axis=1) | (at > 1).any(axis=1)] = np.nan
    return at


def segments() -> Iterator[tuple[Float64, str]]:
    """Yield the lines of the floor, and the edges of the crate, as points and a colour."""
    along = np.linspace(-HALF, HALF, 801)
    for at in range(-HALF, HALF + 1):
        flat = np.full_like(along, at), np.full_like(along, FLOOR)
        yield np.stack([along, flat[1], flat[0]], axis=1), "line"
        yield np.stack([flat[0], flat[1], along], axis=1), "line"
    corners = np.array(
        [[CRATE[i, 0], CRATE[j, 1], CRATE[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    step = np.linspace(0, 1, 201)[:, None]
    for one in range(8):
        for bit in (1, 2, 4):
            if not one & bit:
                yield corners[one] + step * (corners[one | bit] - corners[one]), "s2"


def direction_of(axis: Float64) -> str:
    """Return the name of a direction along an axis of the world."""
    return NAMES[2 * int(np.abs(axis).argmax()) + int(axis.sum() < 0)]


def faces_of_a_lamp() -> Canvas:
    """Six maps of a lamp over a floor, and texels of a face from the side."""
    c = Canvas(
        760,
        336,
        "The six faces of a point light, with their axes; and a texel of a face, whose width grows with depth",
    )
    side, left, top = 112.0, 16.0, 40.0
    c.text(left, 24, "the maps of a lamp above a floor with a crate", 13, bold=True)
    for number, face in enumerate(lamp_faces()):
        x, y = left + (side + 42) * (number // 2), top + (side + 28) * (number % 2)
        c.rectangle((x, y, side, side), "card", "line", False, 0)
        for points, role in segments():
            at = seen(face, points)
            inside = ~np.isnan(at[:, 0])
            ends = np.flatnonzero(np.diff(np.r_[0, inside.astype(int), 0]))
            for first, last in ends.reshape(-1, 2).tolist():
                if last - first > 1:
                    part = at[[first, last - 1]]  # straight lines stay straight
                    c.line(
                        [(x + side * u, y + side * v) for u, v in part.tolist()],
                        role,
                        2 if role == "s2" else 1,
                    )
        c.text(x + 6, y + 16, NAMES[number], 13, bold=True)
        c.arrow(x + 30, y + 10, x + side - 6, y + 10, "s1")
        c.arrow(x + 10, y + 26, x + 10, y + side - 6, "s3")
        c.text(x + side - 30, y + 26, direction_of(face["right"]), 12, role="s1")
        c.text(x + 16, y + side - 10, direction_of(face["down"]), 12, role="s3")
    c.note(left, 330, "blue: right, along rows of texels; green: down")
    _from_the_side(c, (628.0, 54.0))
    return c


def _from_the_side(c: Canvas, eye: Point) -> None:
    """Draw a face of eight texels with its guard, and the widths of a texel at two depths."""
    half, unit = 5, 10.0
    c.text(eye[0] - 104, 24, "a face from the side", 13, bold=True)

    def at(texel: float, depth: float) -> Point:
        return eye[0] + unit * texel * depth, eye[1] + 96 * depth

    for edge in (-half, half - 1):
        c.polygon([eye, at(edge, 2.4), at(edge + 1, 2.4)], "d", "d")
    c.polygon([eye, at(1, 2.4), at(2, 2.4)], "a", "a")
    for texel in range(-half, half + 1):
        c.line([eye, at(texel, 2.4)], "line", 1, dashed=abs(texel) == half)
    for depth, name in ((1.0, "t"), (2.0, "2 t")):
        c.line([at(-half, depth), at(half, depth)], "ink", 1)
        c.line([at(1, depth), at(2, depth)], "mark", 5)
        c.text(at(-half - 0.4, depth)[0], at(0, depth)[1] + 4, name, 12, "end", "mark", bold=True)
    c.circle(*eye, 4, "b", "ink")
    c.text(eye[0] + 10, eye[1] - 2, "lamp", 12)
    c.note(eye[0] - 104, 310, "red: the footprint of a texel")
    c.note(eye[0] - 104, 328, "pink: guard; only kernels read it")
