"""Paths in a section of a Cornell box: reflections, rays towards the lamp, and ends by roulette."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas

Float64 = NDArray[np.float64]

WALLS = (((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.0, 1.0)), ((1.0, 1.0), (0.0, 1.0)))
"""Floor, back wall and ceiling of a box of edge 1, y upwards; the left side is open towards the eye."""
BLOCKS = ((0.3, 0.0, 0.2, 0.24), (0.66, 0.0, 0.2, 0.5))
"""Left, bottom, width and height of what stands on the floor."""
LAMP = ((0.4, 0.985), (0.62, 0.985))
EYE = (-0.42, 0.5)
ALBEDO = 0.7
"""Of all surfaces: a path goes on with this probability after its first reflection."""
TARGETS = (0.13, 0.38, 0.62, 0.83)
"""Heights at which paths enter the box."""
SEED = 266


@dataclass
class Path:
    """The points of a path, the eye first; for each other where its ray to the lamp leads, if it arrives."""

    points: list[Float64]
    to_lamp: list[tuple[Float64, bool]] = field(default_factory=list)
    ended: bool = False
    """Whether roulette ended it; else it left the box."""


def segments() -> Float64:
    """Return (N, 2, 2) both ends of all that a path may hit."""
    found = [*WALLS]
    for x, y, wide, tall in BLOCKS:
        corners = ((x, y), (x, y + tall), (x + wide, y + tall), (x + wide, y))
        found += list(pairwise(corners))
    return np.array(found, np.float64)


def nearest(origin: Float64, direction: Float64, most: float = np.inf) -> tuple[float, Float64]:
    """Return t of the nearest hit before `most`, or infinity, and the normal there, towards the origin."""
    a, b = segments().swapaxes(0, 1)
    along, away = b - a, a - origin
    cross = direction[0] * along[:, 1] - direction[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0]) / cross
        at = (away[:, 0] * direction[1] - away[:, 1] * direction[0]) / cross
    t = np.where((at >= 0) & (at <= 1) & (t > 1e-9) & (t < most), t, np.inf)
    number = int(t.argmin())
    normal = np.array((along[number, 1], -along[number, 0])) / np.linalg.norm(along[number])
    return float(t[number]), -normal if normal @ direction > 0 else normal


def traced() -> list[Path]:
    """Return the paths of the figure."""
    rng, found = np.random.default_rng(SEED), []
    for height in TARGETS:
        path = Path([np.array(EYE)])
        direction = np.array((0.0, height)) - path.points[0]
        while True:
            t, normal = nearest(path.points[-1], direction)
            if not np.isfinite(t):
                path.points.append(path.points[-1] + 0.22 * direction)
                break
            place = path.points[-1] + t * direction + 1e-6 * normal
            path.points.append(place)
            lamp = np.array(LAMP[0]) + rng.uniform() * np.subtract(LAMP[1], LAMP[0])
            if normal @ (lamp - place) > 0:
                stop, _ = nearest(place, lamp - place, 1.0)
                path.to_lamp.append((place + min(stop, 1.0) * (lamp - place), not np.isfinite(stop)))
            sine = 2.0 * rng.uniform() - 1.0  # Lambert's cosine in a plane
            side = np.array((normal[1], -normal[0]))
            direction = sine * side + np.sqrt(1.0 - sine * sine) * normal
            if len(path.points) > 2 and rng.uniform() >= ALBEDO:
                path.ended = True
                break
        found.append(path)
    return found


def paths_in_a_box() -> Canvas:
    """The box from the side, with paths and their rays to the lamp."""
    c = Canvas(760, 400, "Paths in a Cornell box: reflections, rays towards the lamp, and ends by roulette")
    edge, left, floor = 330.0, 170.0, 368.0

    def at(point: Float64 | tuple[float, float]) -> tuple[float, float]:
        return left + edge * float(point[0]), floor - edge * float(point[1])

    c.polygon([at((0, 0)), at((1, 0)), at((1, 1)), at((0, 1))], "card", "card")
    for x, y, wide, tall in BLOCKS:
        c.polygon([at((x, y)), at((x, y + tall)), at((x + wide, y + tall)), at((x + wide, y))], "a")
    c.line([at((0, 0)), at((1, 0)), at((1, 1)), at((0, 1))], "ink", 2)
    c.line([at(LAMP[0]), at(LAMP[1])], "s2", 6)
    for path in traced():
        for place, (end, arrives) in zip(path.points[1:], path.to_lamp, strict=False):
            c.line([at(place), at(end)], "s2" if arrives else "line", 1.5 if arrives else 1, not arrives)
        for a, b in pairwise(path.points):
            c.line([at(a), at(b)], "s1", 1.5, arrow=True)
        for place in path.points[1 : len(path.points) - (not path.ended)]:
            c.circle(*at(place), 3, "s1", "s1")
        if path.ended:
            c.circle(*at(path.points[-1]), 6, "mark", "mark")
    c.circle(*at(EYE), 7, "ink", "ink")
    c.text(at(EYE)[0], at(EYE)[1] - 14, "eye", 13, "middle")
    c.text(at(LAMP[0])[0], at(LAMP[0])[1] - 14, "lamp", 13)
    x = left + edge + 36
    rows = (
        ("s1", False, "a path"),
        ("s2", False, "a ray to the lamp"),
        ("line", True, "one that is blocked"),
    )
    for number, (role, dashed, words) in enumerate(rows):
        y = 90.0 + 30 * number
        c.line([(x, y - 4), (x + 26, y - 4)], role, 2, dashed)
        c.text(x + 34, y, words, 12)
    c.circle(x + 13, 176, 6, "mark", "mark")
    c.text(x + 34, 180, "the end by roulette", 12)
    c.note(x, 226, "A path adds light at each of its")
    c.note(x, 244, "points, times what is left of it.")
    c.note(x, 274, "It ends where it leaves the box,")
    c.note(x, 292, "or by lot.")
    return c
