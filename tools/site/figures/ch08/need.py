"""The texels that a cluster of the picture asks of a light, by the chapter's own rule, and the sizes that there are."""

from __future__ import annotations

import math

import numpy as np

from chapters.ch08.page_table.lamps import level_above, level_of_side, sizes_of
from chapters.ch08.page_table.rule import cluster_resolution, solid_angle
from chapters.ch08.shadows.model import TILE
from tools.site.figures.canvas import Canvas, Point

RADIUS, PIXELS, LARGEST = 1.0, 4096.0, 1024
MARKED = (2.0, 5.0, 15.0)
"""Distances of clusters, in metres, whose resolution is written down."""
FARTHEST = 24.0


def asked(distance: float) -> float:
    """Return the texels along a face that a cluster at a distance asks for."""
    return float(cluster_resolution(distance, RADIUS, PIXELS, LARGEST))


def sizes(distances: np.ndarray) -> list[int]:
    """Return the sizes that point lights get."""
    wish = np.array([asked(one) for one in distances.tolist()])
    counts = np.full(len(wish), 6)
    found: list[int] = sizes_of(level_above(wish, counts, level_of_side(LARGEST // TILE)), counts).tolist()
    return found


def texels_by_need() -> Canvas:
    """Two clusters of equal size as a light sees them, and texels over distance."""
    c = Canvas(
        760,
        324,
        "Two clusters with equally many pixels and their solid angles at a light; texels along a face over distance",
    )
    _clusters(c, (34.0, 178.0))
    _curves(c, (360.0, 42.0, 384.0, 206.0))
    return c


def _clusters(c: Canvas, lamp: Point) -> None:
    """Draw two spheres with the cones in which the light sees them."""
    c.text(16, 24, "a cluster as a light sees it", 13, bold=True)
    scale = 38.0
    for distance, turn, fill in ((6.4, 24.0, "c"), (2.0, -40.0, "a")):
        half, angle = math.asin(RADIUS / distance), math.radians(turn)
        along = math.sqrt(distance**2 - RADIUS**2) * scale
        edges = [
            (lamp[0] + along * math.cos(angle + s * half), lamp[1] - along * math.sin(angle + s * half))
            for s in (-1, 1)
        ]
        c.polygon([lamp, *edges], "b", "line")
        x, y = lamp[0] + distance * scale * math.cos(angle), lamp[1] - distance * scale * math.sin(angle)
        c.circle(x, y, RADIUS * scale, fill, "ink")
        c.text(x, y - 2, f"d = {distance:g} m", 12, "middle")
        c.text(x, y + 14, f"{float(solid_angle(distance, RADIUS)):.2f} sr", 12, "middle")
    c.circle(*lamp, 5, "mark", "ink")
    c.note(16, 288, "The farther one fills a smaller part of the map,")
    c.note(16, 306, "so the map needs more texels for its pixels.")


def _curves(c: Canvas, place: tuple[float, float, float, float]) -> None:
    """Draw what a cluster asks for, and the sizes of faces, over distance."""
    left, top, width, height = place
    c.text(left, 24, f"texels along a face; r = {RADIUS:g} m, {PIXELS:,.0f} pixels", 13, bold=True)

    def at(distance: float, texels: float) -> Point:
        return left + 34 + (width - 34) * distance / FARTHEST, top + height * (1 - texels / 1200)

    for texels in (128, 256, 512, 1024):
        y = at(0, texels)[1]
        c.line([(left + 34, y), (left + width, y)], "card", 1)
        c.text(left + 28, y + 4, str(texels), 11, "end", "soft")
    for metres in (0, 5, 10, 15, 20):
        c.text(at(metres, 0)[0], top + height + 16, f"{metres} m", 11, "middle", "soft")
    c.line([at(0, 0), at(FARTHEST, 0)], "line", 1)
    distances = np.linspace(0.05, FARTHEST, 480)
    steps = sizes(distances)
    c.line([at(one, size) for one, size in zip(distances.tolist(), steps, strict=True)], "s1", 2)
    c.line([at(one, asked(one)) for one in distances.tolist()], "s2", 2.5)
    for distance in MARKED:
        x, y = at(distance, asked(distance))
        c.circle(x, y, 4, "paper", "s2")
        c.text(x + 6, y + 16, f"{asked(distance):.0f}", 12, role="s2", bold=True)
    c.note(left, 288, "orange: what the cluster asks for; inside of it: the most")
    c.note(left, 306, "blue: the size that a point light gets")
