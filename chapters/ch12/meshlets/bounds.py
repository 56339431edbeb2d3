"""Bounds of meshlets: a box and a sphere around the vertices, and a cone around the normals.

Bounds are computed in float64 from the float32 positions and rounded up to float32, so that they hold exactly. A
meshlet with a position that is not finite has NaN in its bounds and no cone: every test of culling then keeps it.
"""

from __future__ import annotations

import numpy as np

from common.scene import Float32, Float64

from .groups import Int64, sizes_of

_UP = np.float32(np.inf)

LINE, PLACE = 1e-6, 1e-9
"""Three corners count as on a line if the height of their triangle is at most LINE of its longest edge, and two as at
one place if they are PLACE of it apart: moved in float32, they end at one place."""


def boxes_and_radii(corners: Float32, starts: Int64) -> tuple[Float32, Float32, Float32]:
    """Return centres (K, 3), half edges (K, 3) and radii (K,) of `corners` (C, 3), for groups that begin at `starts`.

    Rounding: the centre c is a float32, so c + e >= v in real numbers has c + e >= v after rounding too, since rounding
    to nearest is monotone and v is a float32 itself. It is enough that e >= |v - c| in real numbers. In float64 |v - c|
    has a relative error of 2^-53, and the radius one of a few of these; the next float32 above the rounded value is
    larger than the true one by at least 2^-25 of it, which covers both.
    """
    columns = np.ascontiguousarray(corners.T)
    with np.errstate(invalid="ignore", over="ignore"):  # places that are not finite, or nearly so
        low = np.minimum.reduceat(columns, starts, axis=1).astype(np.float64)
        high = np.maximum.reduceat(columns, starts, axis=1).astype(np.float64)
        centres = ((low + high) / 2).astype(np.float32)
        extents = _rounded_up(np.maximum(high - centres, centres - low))
        counts = sizes_of(starts, len(corners))
        offsets = columns - np.repeat(centres.astype(np.float64), counts, axis=1)
        radii = _rounded_up(np.sqrt(np.maximum.reduceat((offsets**2).sum(axis=0), starts)))
    finite = np.isfinite(radii) & np.isfinite(extents).all(axis=0)
    for bounds in (centres, extents, radii):
        bounds[..., ~finite] = np.nan
    return centres.T, extents.T, radii


def _rounded_up(values: Float64) -> Float32:
    """Return the float32 above the nearest to each positive value; 0 is exact."""
    nearest = values.astype(np.float32)
    return np.where(values > 0, np.nextafter(nearest, _UP), nearest)


def normal_cones(triangles: Float32, starts: Int64) -> tuple[Float64, Float64]:
    """Return axes (K, 3) of length 1 and sines (K,) of the half angles of cones around the normals of meshlets.

    `triangles` (T, 3, 3) are the corners, and a meshlet begins at each of `starts`. Triangles with two corners at one
    place cover no pixel and are left out. Three corners on a line can: each is rounded on its own, and then the
    triangle may face either way. A meshlet with one of those has the sine 1, as a cone of 90 degrees or more has, one
    of normals that are not finite, and one of no normal at all.

    Two axes are tried, the mean of the normals and the middle of their box, and the narrower cone is taken. The
    smallest cone (Barequet and Elber 2005, "Optimal bounding cones of vectors in three dimensions") is hardly narrower.
    """
    a, b, c = triangles.astype(np.float64).transpose(1, 2, 0)
    counts = sizes_of(starts, len(triangles))
    axes, sines = np.zeros((3, len(starts))), np.ones(len(starts))
    with np.errstate(invalid="ignore"):  # places that are not finite
        normals = _cross(b - a, c - a)
        lengths = np.sqrt((normals**2).sum(axis=0))
        edges = np.sqrt([((p - q) ** 2).sum(axis=0) for p, q in ((a, b), (b, c), (c, a))])
        longest = edges.max(axis=0)
        flat = edges.min(axis=0) <= PLACE * longest
        on_a_line = ~flat & (lengths <= LINE * longest**2)
        normals /= np.where(lengths == 0, 1.0, lengths)
        lines = np.maximum.reduceat(on_a_line, starts)
        mean = np.add.reduceat(normals, starts, axis=1)
        box = np.minimum.reduceat(normals, starts, axis=1) + np.maximum.reduceat(normals, starts, axis=1)
        for candidate in (mean, box):
            length = np.sqrt((candidate**2).sum(axis=0))
            axis = candidate / np.where(length > 0, length, 1.0)
            around = np.repeat(axis, counts, axis=1)
            cosines = np.where(flat, 1.0, (normals * around).sum(axis=0))
            sine = np.sqrt(np.maximum.reduceat((_cross(normals, around) ** 2).sum(axis=0), starts))
            better = (
                (np.minimum.reduceat(cosines, starts) > 0) & (length > 0) & (sine < sines) & ~lines
            )  # not with NaN
            axes[:, better], sines[better] = axis[:, better], sine[better]
    return axes.T, sines


def _cross(a: Float64, b: Float64) -> Float64:
    """Return the cross products (3, N) of columns; np.cross of rows takes three times as long."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
