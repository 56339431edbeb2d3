"""Lights in bins of depth and in tiles of a picture, as clusters/*.comp of chapter 7 find them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chapters.ch07.clusters.model import STEPS_LOG2
from tools.site.figures.canvas import Canvas, Point

Float64 = NDArray[np.float64]
Bits = NDArray[np.bool_]


@dataclass(frozen=True)
class Light:
    """What a light reaches: a sphere, in metres to the right, upwards and ahead of the eye."""

    x: float
    y: float
    ahead: float
    radius: float

    @property
    def interval(self) -> tuple[float, float]:
        """The depths between which the light gives anything."""
        return self.ahead - self.radius, self.ahead + self.radius

    @property
    def cone(self) -> tuple[Float64, float]:
        """The unit vector towards the middle, and the half angle of the sphere as the eye sees it."""
        middle = np.array([self.x, self.y, self.ahead])
        distance = float(np.linalg.norm(middle))
        return middle / distance, math.asin(min(self.radius / distance, 1.0))


# --- bins of depth ----------------------------------------------------------------------------------------------------

FEWER_LOG2 = 2
"""The figure has 4 bins in each octave; the chapter has 64."""
NEAREST, OCTAVES = 1.0, 4
SIDE_LIGHTS = tuple(
    Light(0.0, y, ahead, radius)
    for y, ahead, radius in (
        (0.9, 1.6, 0.45),
        (-0.8, 2.6, 0.6),
        (0.5, 3.5, 0.9),
        (-0.9, 4.9, 0.7),
        (0.38, 6.6, 1.6),
        (-1.3, 7.0, 0.5),
        (-0.9, 8.7, 0.75),
        (1.0, 9.6, 0.8),
        (-0.8, 12.0, 1.0),
        (0.5, 14.2, 1.2),
    )
)
"""In the order of depth."""
MARKED = 12


def depth_code(depth: float, steps_log2: int) -> int:
    """Return the highest bits of a float32: its exponent, and so many of its mantissa."""
    return int(np.float32(max(depth, 0.0)).view(np.uint32)) >> (23 - steps_log2)


def bin_of(depth: float) -> int:
    """Return the bin of the figure that has this depth; nearer and farther ones are in the first and last one."""
    code = depth_code(depth, FEWER_LOG2) - depth_code(NEAREST, FEWER_LOG2)
    return min(max(code, 0), (OCTAVES << FEWER_LOG2) - 1)


def bin_edge(number: int) -> float:
    """Return the depth at which a bin begins: each octave is cut into equal parts."""
    octave, step = divmod(number, 1 << FEWER_LOG2)
    return NEAREST * 2.0**octave * (1 + step / (1 << FEWER_LOG2))


def lights_of_bin(number: int) -> list[int]:
    """Return the places of the lights whose interval overlaps the bin's."""
    return [
        place
        for place, light in enumerate(SIDE_LIGHTS)
        if bin_of(light.interval[0]) <= number <= bin_of(light.interval[1])
    ]


def bins() -> Canvas:
    """Lights from the side in the order of depth, the bins below them, and one bin with its bits and its two places."""
    c = Canvas(
        760, 404, "Lights in bins of depth: each octave has equal bins, and one bin is shown with its bits"
    )
    left, scale, middle = 20.0, 45.0, 96.0
    count = OCTAVES << FEWER_LOG2

    def at(depth: float) -> float:
        return left + scale * depth

    inside = lights_of_bin(MARKED)
    first, last = at(bin_edge(MARKED)), at(bin_edge(MARKED + 1))
    c.rectangle((first, 8, last - first, 180), "b", "b", False, 0)
    for place, light in enumerate(SIDE_LIGHTS):
        y, radius = middle - scale * light.y, scale * light.radius
        c.raw(
            f'<circle cx="{at(light.ahead):.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="var(--f-a)" '
            f'fill-opacity="0.5" stroke="var(--f-{"mark" if place in inside else "line"})" stroke-width="1.5"/>'
        )
    for place, light in enumerate(SIDE_LIGHTS):
        c.text(at(light.ahead), middle - scale * light.y + 5, str(place), 13, "middle", bold=place in inside)
    c.circle(left, middle, 5, "mark", "ink")
    c.text(left - 8, middle - 12, "eye", 12)
    axis = 190.0
    c.line([(left, axis), (744, axis)], "line", 1.5, arrow=True)
    for number in range(count + 1):
        x, octave = at(bin_edge(number)), number % (1 << FEWER_LOG2) == 0
        c.line(
            [(x, axis - (8 if octave else 4)), (x, axis + (8 if octave else 4))],
            "ink" if octave else "line",
            1,
        )
        if octave:
            c.text(x, axis + 22, f"{bin_edge(number):g} m", 11, "middle", "soft")
    top, wide = 238.0, 720 / count
    c.note(left, top - 10, "the bins: the number of lights that reach into each one")
    for number in range(count):
        fill = "b" if number == MARKED else "card"
        c.box(left + wide * number, top, wide, 26, str(len(lights_of_bin(number))), fill, 12, round=0)
    top = 286.0
    c.text(left, top + 18, f"bin {MARKED}", bold=True)
    for place in range(len(SIDE_LIGHTS)):
        x = left + 66 + 26 * place
        c.box(
            x, top, 26, 26, "1" if place in inside else "0", "b" if place in inside else "paper", 12, round=0
        )
        c.text(x + 13, top + 40, str(place), 11, "middle", "soft")
    between = inside[-1] - inside[0] + 1
    c.note(left + 346, top + 8, f"first {inside[0]}, last {inside[-1]}: {between} lights in this range")
    c.note(left + 346, top + 26, f"its bits: {len(inside)} of them reach into the bin")
    depth = 8.7
    bits = f"{int(np.float32(depth).view(np.uint32)):032b}"
    top = 344.0
    c.text(left, top + 18, f"{depth:g} m")
    parts = (
        (bits[:9], 90.0, "c"),
        (bits[9 : 9 + FEWER_LOG2], 30.0, "b"),
        (bits[9 + FEWER_LOG2 :], 196.0, "paper"),
    )
    x = left + 66
    for words, width, fill in parts:
        c.box(x, top, width, 26, words, fill, 12, round=0)
        x += width
    c.note(left + 66, top + 42, "exponent")
    c.note(left + 66 + 90, top + 42, "mantissa of the float")
    c.note(
        left + 396,
        top + 10,
        f"the highest {9 + FEWER_LOG2} bits, less those of {NEAREST:g} m: bin {bin_of(depth)}",
    )
    c.note(left + 396, top + 28, f"The chapter takes {9 + STEPS_LOG2}: {1 << STEPS_LOG2} bins an octave.")
    return c


# --- tiles of the picture ---------------------------------------------------------------------------------------------

ACROSS, DOWN = 12, 8
"""Tiles of the picture."""
TANGENT = 0.6
"""Of half of the angle of view, horizontally."""
SPHERES = tuple(
    Light(x, y, ahead, radius)
    for x, y, ahead, radius in (
        (-1.1, 0.6, 3.2, 0.35),
        (0.0, -0.9, 3.6, 0.4),
        (1.05, 0.21, 4.2, 0.82),
        (-1.7, -1.0, 5.0, 0.6),
        (0.38, 0.75, 5.6, 0.9),
        (-0.6, 1.9, 7.0, 0.6),
        (2.9, -1.6, 7.4, 0.9),
        (-1.2, -0.9, 8.6, 0.8),
        (3.6, 2.4, 10.0, 1.0),
        (-4.2, 0.1, 11.0, 1.2),
        (7.0, -0.6, 14.0, 1.4),
        (2.2, 1.0, 16.0, 1.7),
    )
)
"""In the order of depth; number CHOSEN is shown with its tiles."""
CHOSEN = 2
PIXEL = (7, 2)
"""The tile of the pixel whose lights are asked for, from the top left."""
PIXEL_AHEAD = 4.85


def through(x: float, y: float) -> Float64:
    """Return the direction through a place of the picture, in tiles from its top left."""
    way = np.array([TANGENT * (2 * x / ACROSS - 1), TANGENT * (1 - 2 * y / DOWN) * DOWN / ACROSS, 1.0])
    found: Float64 = way / np.linalg.norm(way)
    return found


def seen_at(direction: Float64) -> Point:
    """Return where in the picture a direction is, in tiles from its top left."""
    x, y = (float(one) / float(direction[2]) / TANGENT for one in direction[:2])
    return (x + 1) * ACROSS / 2, DOWN / 2 - y * ACROSS / 2


def cone_of_tile(x: int, y: int) -> tuple[Float64, float]:
    """Return the axis of the cone around a tile, and its half angle."""
    axis = through(x + 0.5, y + 0.5)
    corners = [through(x + dx, y + dy) for dx in (0, 1) for dy in (0, 1)]
    return axis, max(math.acos(min(float(axis @ corner), 1.0)) for corner in corners)


def meets(light: Light, x: int, y: int) -> bool:
    """Whether the cone around a tile and the one around a light's sphere meet."""
    (axis, half), (middle, angle) = cone_of_tile(x, y), light.cone
    return math.acos(min(float(axis @ middle), 1.0)) <= half + angle


def outline(light: Light, points: int = 73) -> list[Point]:
    """Return the edge of a light's sphere in the picture."""
    axis, angle = light.cone
    across = np.cross(axis, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    up = np.cross(across, axis)
    turns = np.linspace(0, 2 * np.pi, points)[:, None]
    edge = math.cos(angle) * axis + math.sin(angle) * (np.cos(turns) * across + np.sin(turns) * up)
    return [seen_at(one) for one in edge]


def rectangle_of(light: Light) -> tuple[int, int, int, int]:
    """Return the first tile and the one behind the last, along x and y, of the rectangle around a light's disc."""
    x, y = np.array(outline(light)).T
    low, high = np.floor([x.min(), y.min()]).astype(int), np.ceil([x.max(), y.max()]).astype(int)
    return max(int(low[0]), 0), max(int(low[1]), 0), min(int(high[0]), ACROSS), min(int(high[1]), DOWN)


def bits_of_pixel() -> tuple[Bits, Bits]:
    """Return the bits of the pixel's bin, and those of its tile, of all spheres."""
    code = depth_code(PIXEL_AHEAD, STEPS_LOG2)
    in_bin = [
        depth_code(it.interval[0], STEPS_LOG2) <= code <= depth_code(it.interval[1], STEPS_LOG2)
        for it in SPHERES
    ]
    return np.array(in_bin), np.array([meets(it, *PIXEL) for it in SPHERES])


def tiles() -> Canvas:
    """Discs of lights over tiles, the two cones that a tile's test compares, and the bits of one pixel."""
    c = Canvas(
        760,
        332,
        "Lights over the tiles of a picture, the test of a tile, and the bits of the bin and the tile",
    )
    left, top, side = 14.0, 40.0, 29.0

    def at(place: Point) -> Point:
        return left + side * min(max(place[0], 0.0), ACROSS), top + side * min(max(place[1], 0.0), DOWN)

    chosen = SPHERES[CHOSEN]
    x0, y0, x1, y1 = rectangle_of(chosen)
    c.text(left, 26, f"{ACROSS}x{DOWN} tiles, {len(SPHERES)} lights", 13, bold=True)
    covered = 0
    for y in range(DOWN):
        for x in range(ACROSS):
            covered += (own := meets(chosen, x, y))
            fill = "a" if own else "b" if x0 <= x < x1 and y0 <= y < y1 else "paper"
            c.rectangle((left + side * x, top + side * y, side, side), fill, "line", False, 0)
    for number, light in enumerate(SPHERES):
        role, width = ("mark", 2.5) if number == CHOSEN else ("ink", 1.2)
        c.line([at(place) for place in outline(light)], role, width)
    for number, light in enumerate(SPHERES):
        px, py = at(seen_at(light.cone[0]))
        c.text(px, py + (14 if number == CHOSEN else 4), str(number), 11, "middle")
    px, py = at(PIXEL)
    c.line([(px, py), (px + side, py), (px + side, py + side), (px, py + side), (px, py)], "ink", 3)
    c.note(left, 290, f"Light {CHOSEN} reaches {covered} tiles (blue). The rectangle")
    c.note(left, 306, f"around its disc has {(x1 - x0) * (y1 - y0)}: yellow ones too.")
    _cones(c, (392.0, 112.0))
    _rows(c, (384.0, 190.0))
    return c


def _cones(c: Canvas, eye: Point) -> None:
    """Draw the cones of the chosen light and of the pixel's tile, in the plane through the eye and both axes."""
    (axis, half), (middle, angle) = cone_of_tile(*PIXEL), SPHERES[CHOSEN].cone
    apart, far = math.acos(float(axis @ middle)), 236.0

    def toward(turn: float, length: float) -> Point:
        return eye[0] + length * math.cos(turn), eye[1] - length * math.sin(turn)

    c.polygon([eye, toward(apart - half, 280), toward(apart + half, 280)], "c", "line")
    c.circle(*toward(0.0, far), far * math.sin(angle), "a", "mark")
    for turn in (apart - half, apart + half):
        c.line([eye, toward(turn, 280)], "line", 1)
    for turn in (-angle, angle):
        c.line([eye, toward(turn, far * math.cos(angle))], "mark", 1.2, dashed=True)
    c.line([eye, toward(apart, 290)], "ink", 1)
    c.line([eye, toward(0.0, far)], "mark", 1)
    c.circle(*eye, 4, "f", "ink")
    c.text(eye[0] - 12, eye[1] + 20, "eye", 12)
    c.text(384, 26, "the tile's cone, and the light's", 13, bold=True)
    said = [f"{math.degrees(turn):.1f}" for turn in (apart, half, angle)]
    c.note(384, 176, f"{said[0]} degrees between the axes, at most {said[1]} + {said[2]}")


def _rows(c: Canvas, corner: Point) -> None:
    """Draw the bits of the pixel's bin, of its tile, and of both."""
    in_bin, in_tile = bits_of_pixel()
    left, top = corner
    for row, (words, bits, fill) in enumerate(
        (("bin", in_bin, "b"), ("tile", in_tile, "c"), ("both", in_bin & in_tile, "a"))
    ):
        y = top + 14 + 30 * row
        c.text(left, y + 17, words, 13, bold=row == 2)
        for number, bit in enumerate(bits.tolist()):
            x = left + 46 + 26 * number
            c.box(x, y, 26, 24, "1" if bit else "0", fill if bit else "paper", 12, round=0)
            if row == 0:
                c.text(x + 13, top + 8, str(number), 11, "middle", "soft")
    found = np.flatnonzero(in_bin & in_tile).tolist()
    words = f"the lights {' and '.join(map(str, found))}: {len(found)} of {len(SPHERES)}."
    c.note(left, top + 120, f"A pixel of the marked tile, {PIXEL_AHEAD:g} m ahead, evaluates")
    c.note(left, top + 136, words)
