"""The cascades of the sun as it sees them, made by the chapter for the atrium; and their texels against pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from chapters.ch08.shadows.cascades import corners, directional_faces, slice_sphere, splits
from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]

BOX = np.array([(-22.0, 0.0, -22.0), (22.0, 22.0, 22.0)])
"""The bounds of the atrium, in metres."""
EYE, YFOV, ASPECT = (0.0, 1.7, 15.0), math.radians(60), 16 / 9
CASCADES, SIZE, GUARD, ROWS = 3, 2048, 2, 1080
SUN = np.array([[0.4, -1.0, 0.3]]) / math.sqrt(1.25)
"""The direction in which its light goes."""
COLORS = ("d", "c")


def view(eye: tuple[float, float, float] = EYE) -> View:
    """Return a view along -z."""
    return View(pose_looking_at(eye, (eye[0], eye[1], eye[2] - 1)), Perspective(YFOV, 0.05))


def faces(looking: View | None = None, size: int = SIZE) -> np.ndarray:
    """Return the FACE records of the sun."""
    return directional_faces(SUN, BOX, looking or view(), np.zeros(3), ASPECT, CASCADES, size, GUARD)


def axes() -> Float64:
    """Return (2, 3): to the right and down, as the sun sees it."""
    face = faces()[0]
    return np.stack([face["right"], face["down"]]).astype(np.float64)


def cuts() -> list[float]:
    """Return where the slices of the view begin and end, in metres ahead."""
    distances: list[float] = splits(0.05, float(np.linalg.norm(BOX[1] - BOX[0])), CASCADES).tolist()
    return distances


def half_sizes(face: np.ndarray) -> tuple[float, float]:
    """Return half of the edges of what a face covers without its guard, in metres."""
    used = face["size"] / 2 - face["guard"]
    return float(used / face["scale_x"]), float(used / face["scale_y"])


def texel_at(ahead: float) -> float:
    """Return the edge of the texels that serve the axis of the view at a distance, in metres."""
    point = np.array([EYE[0], EYE[1], EYE[2] - ahead])
    for face in faces():
        if (np.abs(axes() @ (point - face["origin"])) <= half_sizes(face)).all():
            return 1.0 / float(face["scale_x"])
    return math.nan


def pixel_at(ahead: float) -> float:
    """Return the length that a pixel covers, in metres."""
    return 2 * math.tan(YFOV / 2) * ahead / ROWS


def hull(points: Float64) -> Float64:
    """Return the corners of the convex hull of `points` (N, 2), in their order around it."""

    def chain(ordered: list[Float64]) -> list[Float64]:
        found: list[Float64] = []
        for point in ordered:
            while len(found) > 1:
                (ax, ay), (bx, by) = found[-1] - found[-2], point - found[-1]
                if ax * by - ay * bx > 0:
                    break
                found.pop()
            found.append(point)
        return found[:-1]

    ordered = [points[i] for i in np.lexsort((points[:, 1], points[:, 0]))]
    return np.array(chain(ordered) + chain(ordered[::-1]))


def cascades_from_above() -> Canvas:
    """Slices of the view with spheres and squares, and the size of texels over distance."""
    c = Canvas(
        760,
        372,
        "The atrium as the sun sees it: spheres around slices of the view, the squares of two cascades, and the fit",
    )
    scale, middle = 4.9, (186.0, 194.0)
    made, ends = faces(), cuts()
    centre = axes() @ made[-1]["origin"].astype(np.float64)

    def flat(point: tuple[float, float]) -> Point:
        return middle[0] + scale * (point[0] - centre[0]), middle[1] + scale * (point[1] - centre[1])

    def at(point: tuple[float, float, float]) -> Point:
        x, y = (axes() @ np.array(point)).tolist()
        return flat((x, y))

    for number in (2, 1, 0):
        half = half_sizes(made[number])
        x, y = flat(tuple((axes() @ made[number]["origin"].astype(np.float64)).tolist()))
        wide, high = 2 * scale * half[0], 2 * scale * half[1]
        if number == 2:
            c.rectangle((x - wide / 2, y - high / 2, wide, high), "a", "ink", False, 0)
            c.polygon([flat(tuple(one)) for one in hull(corners(BOX) @ axes().T).tolist()], "card", "line")
            c.text(x - wide / 2 + 6, y - high / 2 + 18, "3", 14, bold=True)
            continue
        c.raw(
            f'<rect x="{x - wide / 2:.1f}" y="{y - high / 2:.1f}" width="{wide:.1f}" height="{high:.1f}" '
            f'fill="var(--f-{COLORS[number]})" fill-opacity="0.8" stroke="var(--f-ink)"/>'
        )
        c.text(x - wide / 2 + 6, y - high / 2 + 18, str(number + 1), 14, bold=True)
        _, radius = slice_sphere(view().projection, ASPECT, ends[number], ends[number + 1])
        c.raw(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius * scale:.1f}" fill="none" stroke="var(--f-ink)" '
            f'stroke-dasharray="4 3"/>'
        )
    up = math.tan(YFOV / 2)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    for end in ends[1:3]:
        square = [
            at((EYE[0] + sx * up * ASPECT * end, EYE[1] + sy * up * end, EYE[2] - end)) for sx, sy in signs
        ]
        c.line([*square, square[0]], "s1", 1.5)
    for sx, sy in signs:
        end = ends[2]
        c.line(
            [at(EYE), at((EYE[0] + sx * up * ASPECT * end, EYE[1] + sy * up * end, EYE[2] - end))], "s1", 1.5
        )
    c.circle(*at(EYE), 5, "mark", "ink")
    _curves(c, (424.0, 46.0, 316.0, 232.0))
    return c


def _curves(c: Canvas, place: tuple[float, float, float, float]) -> None:
    """Draw the edges of texels and of pixels over distance."""
    left, top, width, height = place
    farthest, coarsest = 36.0, 0.045
    c.text(left, 24, "edge of a texel along the view, in mm", 13, bold=True)

    def at(ahead: float, edge: float) -> Point:
        return left + 24 + (width - 24) * ahead / farthest, top + height - height * min(edge / coarsest, 1.0)

    for mm in (0, 10, 20, 30, 40):
        y = at(0, mm / 1000)[1]
        c.line([(left + 24, y), (left + width, y)], "card", 1)
        c.text(left + 18, y + 4, str(mm), 11, "end", "soft")
    for metres in (0, 10, 20, 30):
        c.text(at(metres, 0)[0], top + height + 16, f"{metres} m", 11, "middle", "soft")
    distances = np.linspace(0.0, farthest, 361).tolist()
    c.line([at(one, texel_at(one)) for one in distances], "s1", 2.5)
    c.line([at(one, pixel_at(one)) for one in (0.0, farthest)], "s2", 2)
    fit = 1.0 / float(faces()[-1]["scale_x"])
    c.line([at(0.0, fit), at(farthest, fit)], "mark", 1.5, dashed=True)
    edges = [1000 / float(face["scale_x"]) for face in faces()]
    c.note(left, 318, f"blue: cascades, {edges[0]:.1f}, {edges[1]:.1f} and {edges[2]:.1f} mm")
    c.note(left, 336, "red: one map over the scene, dashed")
    c.note(left, 354, f"orange: what one of {ROWS:,} rows of pixels covers")
