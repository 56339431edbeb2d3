"""Ambient occlusion: rays over a profile of depth, and the curve of the estimate from depth alone."""

from __future__ import annotations

import math

import numpy as np

from tools.site.figures.canvas import Canvas, Point

RAYS, STEPS = 8, 4
INDEX = 2
"""The number of the pixel in its block of 4x4: it shifts the points along the rays."""
LEFT_WALL, RIGHT_WALL = (-0.72, 0.55), (0.42, 0.95)
"""Place and height of the two steps of the profile, in radii."""


def height_at(x: float) -> float:
    """Return the height of the profile, in radii above the pixel's surface."""
    if x < LEFT_WALL[0]:
        return LEFT_WALL[1]
    return RIGHT_WALL[1] if x > RIGHT_WALL[0] else 0.0


def hides(behind: float, offset: Point) -> bool:
    """Whether a surface hides a point of a ray: the rule of shaders/ambient_occlusion.glsl, for an upright normal."""
    x, above = offset
    return 0.0 < behind < 1.0 and above > 0.0 and above * above > 0.0025 * (x * x + above * above)


def rays() -> list[tuple[list[Point], bool]]:
    """Return of each ray the points that are tested, in radii from the pixel, and whether the last one is hidden.

    The rays lie in the plane of the drawing, and are as dense as the cosine to the normal.
    """
    found = []
    for ray in range(RAYS):
        sine = 2 * (ray + 0.5) / RAYS - 1
        shift, points, hidden = ((INDEX * 5 + ray * 11 & 15) + 0.5) / 16, [], False
        for number in range(STEPS):
            length = ((number + shift) / STEPS) ** 1.5
            x, y = length * sine, length * math.sqrt(1 - sine * sine)
            points.append((x, y))
            if hidden := hides(height_at(x) - y, (x, height_at(x))):
                break
        found.append((points, hidden))
    return found


def estimate(hidden: int) -> float:
    """Return the visibility that depth alone gives if so many of the eight samples are one radius nearer to the eye."""
    occlusion = 15 * 1.0 * (2 - 1.0)
    total = RAYS - hidden + hidden / (1 + occlusion**2)
    return min(max(total * total / 64 + 0.45, 0.0), 1.0)


def rays_over_depth() -> Canvas:
    """Rays of a pixel over a profile of depth, and the curve of the estimate from depth alone."""
    c = Canvas(
        760,
        316,
        "Rays of the hemisphere over a profile of depth, and the curve of the estimate from depth alone",
    )
    x, y, radius = 190.0, 240.0, 136.0

    def at(px: float, py: float) -> Point:
        return x + radius * px, y - radius * py

    edge = 1.28
    (lx, lh), (rx, rh) = LEFT_WALL, RIGHT_WALL
    ground = [(-edge, -0.2), (-edge, lh), (lx, lh), (lx, 0.0), (rx, 0.0), (rx, rh), (edge, rh), (edge, -0.2)]
    c.polygon([at(*one) for one in ground], "card", "card")
    c.line([at(*one) for one in ground[1:-1]], "ink", 2)
    arc = np.linspace(0, np.pi, 49)
    c.line([at(math.cos(a), math.sin(a)) for a in arc.tolist()], "line", 1, dashed=True)
    count = 0
    for ray, (points, hidden) in enumerate(rays()):
        count += hidden
        sine = 2 * (ray + 0.5) / RAYS - 1
        end = points[-1] if hidden else (sine, math.sqrt(1 - sine * sine))
        c.line([at(0, 0), at(*end)], "mark" if hidden else "s1", 1.5, arrow=not hidden)
        for number, point in enumerate(points):
            last = hidden and number == len(points) - 1
            c.circle(*at(*point), 4 if last else 2.5, "mark" if last else "paper", "mark" if last else "s1")
    c.circle(*at(0, 0), 4, "ink", "ink")
    c.text(14, 24, "the eye looks down")
    c.arrow(30, 36, 30, 78, "ink")
    c.text(*at(0.04, -0.14), "pixel", 12, "middle")
    c.note(14, 290, f"{RAYS} rays, at most {STEPS} points each; {count} rays end behind a surface")
    c.note(14, 308, f"that is seen (red): visible is 1 - {count}/{RAYS} = {1 - count / RAYS:g}")
    left, top, wide, tall = 440.0, 60.0, 288.0, 180.0
    c.text(left - 30, 24, "from depth alone: visibility with k hidden samples", 12, bold=True)
    for value in (0.0, 0.5, 1.0):
        c.line([(left, top + tall * (1 - value)), (left + wide, top + tall * (1 - value))], "card", 1)
        c.text(left - 10, top + tall * (1 - value) + 4, f"{value:g}", 11, "end", "soft")
    c.line([(left, top), (left, top + tall), (left + wide, top + tall)], "line", 1)
    c.line([(left, top), (left + wide, top + tall)], "line", 1.5, dashed=True)
    places = [(left + wide * k / RAYS, top + tall * (1 - estimate(k))) for k in range(RAYS + 1)]
    c.line(places, "s1", 2)
    for k, (px, py) in enumerate(places):
        c.circle(px, py, 3.5, "s1", "s1")
        c.text(px + 2, py - 9, f"{estimate(k):.2f}", 11, "middle")
        c.text(px, top + tall + 18, str(k), 11, "middle", "soft")
    c.note(left + 40, top + tall - 12, "dashed: 1 - k/8")
    c.note(left - 30, 290, "Two hidden samples of eight count as none: each")
    c.note(left - 30, 308, f"slope hides a part of itself. Eight leave {estimate(RAYS):.2f}.")
    return c
