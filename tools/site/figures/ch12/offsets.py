"""How far rays begin from a surface, by the distance of the surface from the origin."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

UNIT = 2.0**-24
EDGE = 1.0
"""Metres, of the triangle's edges."""


def offset(corners: float, translation: float, edge: float = EDGE) -> float:
    """Return the offset along one axis (shaders/ray_offset.glsl) of a triangle at right angles to that axis.

    `corners` is its largest coordinate in object space, `translation` that of the instance, `edge` two edges together.
    """
    return UNIT * (7 * (corners + translation) + 5 * corners + 20 * edge)


def offsets_by_distance() -> Canvas:
    """Two ways in which a surface may be far away, and a constant."""
    distances = [10.0 ** (power / 4) for power in range(-8, 25)]
    mesh = [(far, offset(far, 0.0, 0.01)) for far in distances]
    instance = [(far, offset(1.0, far)) for far in distances]
    return curves(
        "Distance at which rays begin from a surface",
        Axis("distance from the origin, metres", log=True),
        Axis("offset, metres", log=True),
        (
            Curve("a mesh far away", mesh, marks=False),
            Curve("an instance far away", instance, marks=False),
            Curve(
                "a constant millimetre",
                [(distances[0], 1e-3), (distances[-1], 1e-3)],
                dashed=True,
                marks=False,
            ),
        ),
        "Triangles with edges of 1 cm in the mesh, of 1 m in the instance; no smaller offset is safe",
    )
