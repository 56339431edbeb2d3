"""Figures of chapter 7: octahedral normals, light lists, ambient occlusion, automatic exposure, layers of a pixel."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .canvas import Canvas, Point
from .exposure import histogram
from .lights import bins, tiles

Float64 = NDArray[np.float64]

# --- octahedral normals -----------------------------------------------------------------------------------------------

CELL = 15
"""Degrees of longitude and latitude of a cell of the sphere."""
DIRECTIONS = 200_000


def octahedral(n: Float64) -> Float64:
    """Return the code (..., 2), from -1 to 1, of unit vectors (..., 3): see shaders/octahedral.glsl."""
    p = n[..., :2] / np.abs(n).sum(axis=-1, keepdims=True)
    folded = (1 - np.abs(p[..., ::-1])) * np.where(p >= 0, 1, -1)
    return np.where(n[..., 2:] < 0, folded, p)


def direction(code: Float64) -> Float64:
    """Return the unit vectors (..., 3) of codes (..., 2)."""
    z = 1 - np.abs(code).sum(axis=-1, keepdims=True)
    xy = code - np.maximum(-z, 0) * np.where(code >= 0, 1, -1)
    n = np.concatenate([xy, z], axis=-1)
    return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))


@cache
def errors() -> dict[str, tuple[float, float, int]]:
    """Return of each way to store a normal the largest and the mean turn in degrees, and its bytes."""
    random = np.random.default_rng(7)
    n = random.normal(size=(DIRECTIONS, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    ten = (np.round(n * 511 + 512) - 512) / 511
    half = n.astype(np.float16).astype(np.float64)
    short = direction(np.round(octahedral(n) * 32767) / 32767)
    found = {}
    for name, back, size in (
        ("3 x 10 bits", ten, 4),
        ("3 halves", half, 8),
        ("2 x 16 bits, octahedral", short, 4),
    ):
        back = back / np.linalg.norm(back, axis=1, keepdims=True)
        # Of the chord between unit vectors, which is exact for small angles.
        turn = np.degrees(2 * np.arcsin(np.linalg.norm(back - n, axis=1) / 2))
        found[name] = float(turn.max()), float(turn.mean()), size
    return found


def cells() -> list[tuple[Float64, Float64, str]]:
    """Return cells of the sphere: unit vectors (4, 3), their codes (4, 2), and the colour of their octant."""
    found = []
    for up in range(-90, 90, CELL):
        for around in range(0, 360, CELL):
            corners = np.radians(
                [(around + dx, up + dy) for dx, dy in ((0, 0), (CELL, 0), (CELL, CELL), (0, CELL))]
            )
            long, lat = corners.T
            n = np.stack([np.cos(lat) * np.cos(long), np.cos(lat) * np.sin(long), np.sin(lat)], axis=-1)
            # A corner on the edge of an octant has the code of its own cell's octant.
            middle = n.mean(axis=0)
            code = octahedral(n + 1e-9 * (middle - n))
            quarter = around // 90
            found.append((n, code, "abcd"[quarter] if up >= 0 else "ef"[quarter % 2]))
    return found


def octahedral_normals() -> Canvas:
    """A sphere in cells, the same cells in the square of the code, and what three ways to store a normal lose."""
    c = Canvas(
        760,
        316,
        "The directions of the sphere in the square of the octahedral code, and the errors of three codes",
    )
    turn, tilt = math.radians(-28), math.radians(22)
    right = np.array([math.cos(turn), math.sin(turn), 0])
    toward = np.array([math.cos(tilt) * math.sin(turn), -math.cos(tilt) * math.cos(turn), math.sin(tilt)])
    up = np.cross(toward, right)
    x, y, radius = 122.0, 160.0, 106.0
    left, top, half = 256.0, 54.0, 106.0

    def on_sphere(n: Float64) -> Point:
        return x + radius * float(n @ right), y - radius * float(n @ up)

    def on_square(code: Float64) -> Point:
        return left + half * (1 + float(code[0])), top + half * (1 - float(code[1]))

    for n, code, fill in cells():
        if float(n.mean(axis=0) @ toward) > 0:
            c.polygon([on_sphere(one) for one in n], fill, "line")
        c.polygon([on_square(one) for one in code], fill, "line")
    for one, words in (((1, 0, 0), "+x"), ((0, -1, 0), "-y"), ((0, 0, 1), "+z")):
        px, py = on_sphere(np.array(one, np.float64))
        c.circle(px, py, 3, "ink", "ink")
        c.text(px + 7, py - 5, words, 13, bold=True)
    axes = (
        ((0.0, 0.0), "+z"),
        ((1.0, 0.0), "+x"),
        ((-1.0, 0.0), "-x"),
        ((0.0, 1.0), "+y"),
        ((0.0, -1.0), "-y"),
    )
    corners = tuple(((sx, sy), "-z") for sx in (-1.0, 1.0) for sy in (-1.0, 1.0))
    for place, words in (*axes, *corners):
        px, py = on_square(np.array(place))
        c.circle(px, py, 3, "ink", "ink")
        if words == "-z":
            c.text(px, py + (-6 if place[1] > 0 else 17), words, 13, "middle", bold=True)
        elif place[0] == 0:
            c.text(px + 7, py + (-6 if place[1] >= 0 else 17), words, 13, bold=True)
        else:
            c.text(px + 6 * place[0], py + 5, words, 13, "start" if place[0] > 0 else "end", bold=True)
    shown = np.array([0.45, -0.72, -0.53])
    shown /= np.linalg.norm(shown)
    for px, py in (on_sphere(shown), on_square(octahedral(shown))):
        c.circle(px, py, 5, "mark", "paper")
    c.text(16, 26, "the sphere")
    c.text(left, 26, "the square")
    c.note(16, 288, "upper half: the inner diamond;")
    c.note(16, 305, "lower half: triangles, folded out")
    c.note(left, 305, "red: the same direction", "mark")
    c.text(516, 26, "stored and read: the largest turn")
    most = max(largest for largest, _, _ in errors().values())
    for row, (name, (largest, mean, size)) in enumerate(errors().items()):
        py = 54.0 + 76 * row
        c.text(516, py + 10, f"{name}: {size} bytes", 12, bold=row == 2)
        c.box(516, py + 18, 200 * largest / most, 18, "", "ab"[row == 2], round=0)
        c.note(516, py + 52, f"{largest:.4f} degrees, on average {mean:.4f}")
    c.note(516, 288, f"of {DIRECTIONS:,} random directions;")
    c.note(516, 305, "a mirror shows twice the turn")
    return c


# --- ambient occlusion ------------------------------------------------------------------------------------------------

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


def occlusion() -> Canvas:
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


# --- the layers of a pixel --------------------------------------------------------------------------------------------

ARRIVED = (
    (2, "A", 0.20, (0.9, 0.2, 0.1), 0.5),
    (0, "A", 0.22, (0.9, 0.2, 0.1), 0.5),
    (3, "B", 0.60, (0.1, 0.4, 0.9), 0.4),
    (2, "B", 0.55, (0.1, 0.4, 0.9), 0.4),
    (0, "C", 0.35, (0.2, 0.8, 0.2), 0.6),
    (5, "C", 0.40, (0.2, 0.8, 0.2), 0.6),
    (2, "C", 0.38, (0.2, 0.8, 0.2), 0.6),
    (5, "A", 0.25, (0.9, 0.2, 0.1), 0.5),
)
"""Layers in the order in which they arrive: pixel, name, depth (1 is near), linear colour, opacity."""
PIXELS, SHOWN = 6, 2
UNDER = (0.8, 0.8, 0.8)


def lists() -> tuple[list[int], list[int], list[int], list[int]]:
    """Return of each pixel its count, where its layers begin, where they end, and the layer at each place."""
    counts = [sum(one[0] == pixel for one in ARRIVED) for pixel in range(PIXELS)]
    begins = [sum(counts[:pixel]) for pixel in range(PIXELS)]
    words, places = [*begins], [-1] * len(ARRIVED)
    for number, (pixel, *_) in enumerate(ARRIVED):
        places[words[pixel]] = number  # atomicAdd returns the place, and the word moves on
        words[pixel] += 1
    return counts, begins, words, places


def composited() -> list[tuple[int, Float64]]:
    """Return the layers of the pixel that is shown, farthest first, each with the colour after it."""
    _, begins, ends, places = lists()
    own = sorted(places[begins[SHOWN] : ends[SHOWN]], key=lambda number: ARRIVED[number][2])
    color, found = np.array(UNDER), []
    for number in own:
        *_, layer, opacity = ARRIVED[number]
        color = np.array(layer) * opacity + color * (1 - opacity)
        found.append((number, color))
    return found


def _shade(color: Float64) -> str:
    codes = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * one):02x}" for one in codes.tolist())


def layers() -> Canvas:
    """Counts of pixels, their sums, the pool as it is filled, and one pixel's list, sorted and composited."""
    c = Canvas(
        760,
        366,
        "The lists of layers: counted, summed, filled as they arrive, sorted by depth and composited",
    )
    counts, begins, ends, places = lists()
    left, step = 190.0, 62.0
    fills = "abcdef"
    rows = ((30.0, "1. count the layers", counts), (78.0, "2. sum before each pixel", begins))
    for y, words, values in rows:
        c.text(12, y + 19, words)
        for pixel, value in enumerate(values):
            c.box(left + step * pixel, y, 52, 28, str(value), fills[pixel] if counts[pixel] else "paper")
    for pixel in range(PIXELS):
        c.text(left + step * pixel + 26, 22, f"pixel {pixel}", 11, "middle", "soft")
    c.note(left + step * PIXELS + 8, 97, f"together {sum(counts)}")
    c.text(12, 169, "3. fill as they arrive")
    for place, number in enumerate(places):
        pixel, name, depth, *_ = ARRIVED[number]
        c.box(left + step * place, 148, 52, 36, f"{name}\n{depth:.2f}", fills[pixel], 11)
        c.text(left + step * place + 26, 199, str(number + 1), 11, "middle", "soft")
    for pixel in range(PIXELS):
        if counts[pixel]:
            c.arrow(left + step * pixel + 26, 106, left + step * begins[pixel] + 26, 148)
    c.note(
        left,
        217,
        f"below: which one arrived when. Afterwards each word is an end: {', '.join(map(str, ends))}",
    )
    c.text(12, 258, f"4. sort pixel {SHOWN}")
    c.text(12, 316, "5. composite")
    c.rectangle((left, 298, 52, 28), "card", "line", False, 4)
    c.raw(f'<rect x="{left:g}" y="298" width="52" height="28" rx="4" fill="{_shade(np.array(UNDER))}"/>')
    c.text(left + 26, 342, "solid", 11, "middle", "soft")
    for place, (number, color) in enumerate(composited(), 1):
        _, name, depth, layer, opacity = ARRIVED[number]
        x = left + 104 * place
        c.box(x, 234, 52, 36, f"{name}\n{depth:.2f}", fills[SHOWN], 11)
        c.raw(
            f'<rect x="{x + 58:g}" y="244" width="16" height="16" rx="2" fill="{_shade(np.array(layer))}"/>'
        )
        c.text(x + 26, 285, f"opacity {opacity:g}", 11, "middle", "soft")
        c.arrow(x - 52, 312, x, 312)
        c.raw(f'<rect x="{x:g}" y="298" width="52" height="28" rx="4" fill="{_shade(color)}"/>')
        c.text(x + 26, 342, " ".join(f"{one:.2f}" for one in color), 11, "middle", "soft")
    c.note(12, 360, "1 is near (reversed depth): the smallest depth is the farthest layer, and comes first.")
    return c


FIGURES = {
    "ch07-octahedral": octahedral_normals,
    "ch07-bins": bins,
    "ch07-tiles": tiles,
    "ch07-occlusion": occlusion,
    "ch07-histogram": histogram,
    "ch07-layers": layers,
}
