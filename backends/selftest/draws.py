"""What the self-tests of both backends draw: shaders, what they read, and the pictures that are right.

They are numbers, (16, 16) uint32; 0 is what nothing was drawn to. `selftest_data` says what BIND is.
"""

from __future__ import annotations

import numpy as np

from backends.selftest.data import SIZE as SIZE
from backends.selftest.data import differ

ONE_FRAGMENT = "layout(location = 0) out uint color; void main() { color = 1u; }"

NUMBER_FRAGMENT = """
layout(location = 0) flat in uint number;
layout(location = 0) out uint color;
void main() { color = number; }
"""

PULLED_VERTEX = """
layout(BIND(0, 0, 0), std430) readonly buffer Vertices { vec2 corners[]; };
layout(BIND(0, 1, 1), std430) readonly buffer Colors { uint colors[]; };
layout(location = 0) flat out uint number;
void main() {
    number = colors[INSTANCE_ID];
    gl_Position = vec4(corners[VERTEX_ID] * 0.5 + vec2(INSTANCE_ID == 3 ? -0.5 : 0.5, -0.5), 0.5, 1.0);
}
"""
PULLED_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
PULLED_COLORS = np.array([1, 2, 3, 40, 50, 6], np.uint32)
PULLED_INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint32)
PULLED_INSTANCES = (3, 2)
"""The first one, and how many."""


def pulled_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture by PULLED_VERTEX: a square of each instance, in the upper half."""
    expected = np.zeros((16, 16), np.uint32)
    expected[:8, :8], expected[:8, 8:] = 40, 50
    return differ("pixels", pixels, expected)


SQUARES_VERTEX = """
layout(location = 0) flat out uint number;
void main() {
    uint tile = uint(INSTANCE_ID);
    number = uint(DRAW) * 100u + tile + 1u;
    uint corner = uint[](0, 1, 2, 2, 1, 3)[VERTEX_ID % 6];
    vec2 at = vec2(tile % 8u, tile / 8u) + vec2(corner & 1u, corner >> 1u);
    gl_Position = vec4(at / 4.0 - 1.0, 0.5, 1.0);
}
"""
"""Draws square `tile` of 8 in a row with its number, and 100 for each draw before it where DRAW is that number."""

SQUARES_VERTICES = 12
"""Vertices 0 to 5 are a square, and so are 6 to 11."""

MULTI_DRAWS = np.array([(6, 3, 0, 0), (6, 0, 0, 4), (6, 2, 6, 8), (6, 1, 0, 63)], np.uint32)
"""Vertices, instances, first vertex, first instance: squares 0-2, none, 8-9 and 63."""

COUNTED_DRAWS = np.array([(6, 3, 0, 0), (6, 0, 0, 4), (6, 2, 6, 8), (6, 9, 0, 20)], np.uint32)
"""The same with squares 0-2, none, 8-9, and one draw beyond the count, which is COUNT."""

COUNT = np.array([3], np.uint32)


def squares() -> np.ndarray:
    """Return (16, 16) int64: the number of each square, from 1 on."""
    return np.add.outer(8 * (np.arange(16) // 2), np.arange(16) // 2) + 1


def multi_draws_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture of MULTI_DRAWS, where DRAW is 0."""
    every = squares()
    return differ(
        "pixels", pixels, np.where(np.isin(every, (1, 2, 3, 9, 10, 64)), every, 0).astype(np.uint32)
    )


def counted_draws_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture of the first COUNT of COUNTED_DRAWS, where DRAW is the draw's number."""
    every = squares()
    expected = np.where(every <= 3, every, np.where(np.isin(every, (9, 10)), every + 200, 0))
    return differ("pixels", pixels, expected.astype(np.uint32))


TWICE_VERTEX = """
void main() {
    vec2 corner = vec2(VERTEX_ID % 3 == 1 ? 3 : -1, VERTEX_ID % 3 == 2 ? 3 : -1);
    gl_Position = vec4(corner, 0.5, 1);
}
"""
"""Covers everything twice with 6 vertices."""


def drawn_counts_wrong(pixels: np.ndarray, vertices: int, primitives: int, fragments: int) -> str:
    """Return what is wrong with the counts of a draw of TWICE_VERTEX with ONE_FRAGMENT, or with its picture."""
    if not (pixels == 1).all():
        return "the counted draw did not cover its target"
    # Two triangles that cover all 256 pixels each, in order and without a depth test.
    for what, counted, number in (("vertices", vertices, 6), ("primitives", primitives, 2)):
        if counted != number:
            return f"{counted} {what} were counted and there are {number}"
    # A driver may leave out fragments that it knows to be hidden, never those that are seen.
    if not 256 <= fragments <= 512:
        return f"{fragments} fragments were counted where two triangles cover 256 pixels each"
    return ""


WIREFRAME_VERTEX = """
const vec2 CORNERS[3] = vec2[](vec2(2.5, 2.5), vec2(13.5, 2.5), vec2(2.5, 13.5));
void main() { gl_Position = vec4(CORNERS[VERTEX_ID] / 8.0 - 1.0, 0.5, 1); }
"""


def wireframe_wrong(pixels: np.ndarray) -> str:
    """Return what is wrong with a picture of WIREFRAME_VERTEX drawn as lines."""
    y, x = np.mgrid[0:16, 0:16] + 0.5
    # The distance of each pixel's centre to the nearest of the three lines, and whether it is inside by more.
    inner = np.minimum(np.minimum(x - 2.5, y - 2.5), (16.0 - x - y) / np.sqrt(2.0))
    if (pixels[np.abs(inner) > 1.5] != 0).any():
        return "pixels away from the edges were drawn"
    # The pixels of the two straight edges, without their ends, where lines of drivers differ.
    if not (pixels[2, 5:11] == 1).all() or not (pixels[5:11, 2] == 1).all():
        return "pixels of a straight edge are missing"
    # The diagonal is 11 pixels long; drivers differ in the two at its ends.
    diagonal = pixels[np.abs(x + y - 16.0) < 1.1].sum()
    return "" if diagonal >= 9 else "the diagonal edge is missing"
