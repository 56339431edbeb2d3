"""Two triangles beside an edge, and rays at that edge: what each arithmetic says of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas

RAYS = 200_000

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


def ends() -> tuple[Float32, Float32]:
    """Return (RAYS, 2) both ends of an edge in the plane in which the ray is (0, 0), nearly on the edge."""
    rng = np.random.default_rng(12)
    p = rng.uniform(-1, 1, (RAYS, 2))
    away = -p * rng.uniform(0.2, 2.0, (RAYS, 1))
    q = away * (1 + rng.normal(0, 4e-8, (RAYS, 2)))
    return p.astype(np.float32), q.astype(np.float32)


def plain(p: Float32, q: Float32) -> Float64:
    """Return the edge function with a rounding of each product and of the difference."""
    return (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).astype(np.float64)


def contracted(p: Float32, q: Float32) -> Float64:
    """Return it as a multiply-add computes it: the first product is not rounded."""
    first = p[:, 0].astype(np.float64) * q[:, 1]
    second: Float64 = (p[:, 1] * q[:, 0]).astype(np.float64)
    return (first - second).astype(np.float32).astype(np.float64)


def exact(p: Float32, q: Float32) -> Float64:
    """Return it in double precision, where both products have all of their digits."""
    return p[:, 0].astype(np.float64) * q[:, 1] - p[:, 1].astype(np.float64) * q[:, 0]


WAYS = {"precise, rounded products": plain, "contracted to a multiply-add": contracted}


def shares(way: str) -> tuple[float, float, float]:
    """Return the shares of rays that pass between both triangles, that hit one, and that hit both.

    The triangles lie on both sides of the edge, and see its ends in opposite order. Each one is hit where its own edge
    function is at least 0. A precise zero is asked again with all digits.
    """
    p, q = ends()
    left, right = WAYS[way](p, q), WAYS[way](q, p)
    if way.startswith("precise"):
        again = exact(p, q)
        left, right = np.where(left == 0, again, left), np.where(right == 0, -again, right)
    hits = (left >= 0).astype(int) + (right >= 0)
    counts = np.bincount(hits, minlength=3) / len(p)
    return float(counts[0]), float(counts[1]), float(counts[2])


def edges_by_arithmetic() -> Canvas:
    """The edge with its triangles, and bars of shares."""
    c = Canvas(
        760, 300, "Rays at an edge between two triangles: gaps, single hits and double hits by arithmetic"
    )
    a, b, left, right = (150.0, 60.0), (190.0, 240.0), (40.0, 170.0), (310.0, 120.0)
    c.polygon([a, b, left], "a")
    c.polygon([a, right, b], "b")
    c.circle(170, 150, 5, "mark", "mark")
    c.text(180, 146, "ray", 12)
    c.text(a[0] - 6, a[1] - 8, "p", 13, "end")
    c.text(b[0] + 6, b[1] + 16, "q", 13)
    c.text(60, 196, "p × q", 13, role="ink")
    c.text(238, 178, "q × p", 13, role="ink")
    c.note(24, 282, "One edge, seen from both sides: e(q, p) has to be -e(p, q).")
    for number, way in enumerate(WAYS):
        gaps, single, double = shares(way)
        y = 70.0 + 100 * number
        c.text(380, y - 12, way, 13, bold=True)
        start = 380.0
        for share, fill in ((gaps, "d"), (single, "c"), (double, "e")):
            c.rectangle((start, y, 350 * share, 24), fill, "line", False, 0)
            start += 350 * share
        said = f"neither {100 * gaps:.0f} %, one {100 * single:.0f} %, both {100 * double:.0f} %"
        c.note(380, y + 42, said)
    c.note(380, 250, f"{RAYS:,} rays within some roundings of the edge;")
    c.note(380, 268, "neither: the ray passes between both triangles.")
    return c
