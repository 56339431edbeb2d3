"""Triangles drawn by the device layer alone, against edge functions in float64 with the top-left rule."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.drawing import PASS_ON, draw

SIZE = (96, 80)
GRID = 16
"""Corners lie on sixteenths of a pixel, which every rasteriser represents: then its coverage has one right answer."""

ONE = "layout(location = 0) out vec4 out_color; void main() { out_color = vec4(1.0); }"


def coverage(corners: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return (H, W) int: how many of the triangles (N, 3, 2), in pixels, cover each pixel's centre."""
    return edges(corners, size)[0]


def edges(corners: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the counts of `coverage`, and (H, W) bool: is a centre off all edges, but within 1/256 pixel of one?

    A centre on an edge belongs to the triangle if the edge is a top or a left one (Vulkan specification, "Basic Polygon
    Rasterization"). Exact: all numbers are small multiples of 1/32.
    """
    width, height = size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    counts, near = np.zeros((height, width), int), np.zeros((height, width), bool)
    for triangle in corners.astype(np.float64):
        (ax, ay), (bx, by) = triangle[1] - triangle[0], triangle[2] - triangle[0]
        area = ax * by - ay * bx
        if area == 0.0:
            continue
        if area < 0.0:
            triangle = triangle[::-1]
        inside = np.ones((height, width), bool)
        for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            dx, dy = end - start
            value = dx * (y - start[1]) - dy * (x - start[0])
            top_left = dy < 0 or (dy == 0 and dx > 0)  # clockwise on the screen, where y points down
            inside &= (value >= 0) if top_left else (value > 0)
            near |= (value != 0) & (np.abs(value) < np.hypot(dx, dy) / 256)
        counts += inside
    return counts, near


def rasterised(device, corners, size=SIZE, fragment=ONE, **more):
    """Draw triangles (N, 3, 2) in pixels, one fragment adding 1."""
    clip = np.zeros((*corners.shape[:2], 4), np.float32)
    clip[..., :2] = 2.0 * corners / np.array(size) - 1.0
    clip[..., 3] = 1.0
    return draw(device, fragment, size, vertex=PASS_ON, vertices=clip.reshape(-1, 4), add=True, **more)


def snapped(points):
    return np.round(np.asarray(points) * GRID) / GRID


# Powers of two, so that pixels become clip coordinates and pixels again without rounding.
EXACT = (128, 64)


@pytest.mark.parametrize("mirrored", [False, True])
def test_one_triangle_covers_exactly_its_pixels(vulkan_device, mirrored):
    corners = snapped([[(8.3, 3.1), (119.9, 20.2), (40.6, 60.7)]])
    corners = corners[:, ::-1] if mirrored else corners
    picture = rasterised(vulkan_device, corners, EXACT)
    expected = coverage(corners, EXACT)
    assert 2000 < expected.sum() < 4000
    assert np.array_equal(picture, np.repeat(expected[..., None], 4, axis=2))


def test_centres_on_edges_belong_to_top_and_left(vulkan_device):
    """Corners on pixel centres: every edge runs through centres, and half of them count."""
    corners = np.array([[(10.5, 10.5), (30.5, 10.5), (10.5, 30.5)]])
    picture = rasterised(vulkan_device, corners, EXACT)[..., 0]
    assert np.array_equal(picture, coverage(corners, EXACT))
    assert picture[10, 10] == 1, "the corner of a top and a left edge"
    assert picture[10, 30] == 0
    assert picture[20, 20] == 0, "on the slanted edge, which is right and bottom"
    assert picture.sum() == 20 * 21 / 2


def test_no_pixel_of_a_shared_edge_is_covered_twice_or_left_out(vulkan_device):
    """A fan around a point, its corners on pixel centres: the whole polygon once, and nothing of the spokes twice."""
    rng = np.random.default_rng(3)
    for _ in range(4):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 12))
        ring = np.floor(np.stack([64 + 50 * np.cos(angles), 32 + 26 * np.sin(angles)], axis=1)) + 0.5
        centre = np.array([64.5, 32.5])
        fan = np.stack([np.broadcast_to(centre, ring.shape), ring, np.roll(ring, -1, axis=0)], axis=1)
        picture = rasterised(vulkan_device, fan, EXACT)[..., 0]
        assert np.array_equal(picture, coverage(fan, EXACT))
        assert picture.max() == 1


def test_a_grid_of_random_triangles_covers_everything_once(vulkan_device):
    """A grid whose inner corners were moved at random, each cell cut in two: every pixel once."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(0, 129, 16.0), np.arange(0, 65, 16.0))
    points = np.stack([x, y], axis=-1)
    points[1:-1, 1:-1] += snapped(rng.uniform(-3.5, 3.5, points[1:-1, 1:-1].shape))
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, b, c], 2).reshape(-1, 3, 2), np.stack([a, c, d], 2).reshape(-1, 3, 2)]
    )
    assert (coverage(triangles, EXACT) == 1).all()
    assert (rasterised(vulkan_device, triangles, EXACT) == 1.0).all()


def test_many_random_triangles_match_the_edge_functions(vulkan_device):
    rng = np.random.default_rng(11)
    triangles = snapped(rng.uniform((-20, -20), (148, 84), (200, 3, 2)))
    triangles[:20, 2] = triangles[:20, 1]  # without area
    expected, near = edges(triangles, EXACT)
    picture = rasterised(vulkan_device, triangles, EXACT)[..., 0]
    assert expected.max() > 20
    # A rasteriser may keep fewer digits than the corners have: the software driver errs at 2e-4 pixels of an edge.
    assert near.mean() < 0.1
    assert np.array_equal(picture[~near], expected[~near])


def test_a_target_keeps_its_clear_value_where_nothing_is_drawn(vulkan_device):
    corners = snapped([[(1.0, 1.0), (9.0, 1.0), (1.0, 9.0)]])
    clear = (0.25, 0.5, 0.75, 1.0)
    picture = rasterised(vulkan_device, corners, EXACT, clear=clear)
    inside = coverage(corners, EXACT).astype(bool)
    assert (picture[~inside] == np.float32(clear)).all()
    assert (picture[inside] == np.float32(clear) + 1).all()


def test_fragments_lie_at_the_centres_of_pixels_and_row_0_is_on_top(vulkan_device):
    where = "layout(location = 0) out vec4 out_color; void main() { out_color = gl_FragCoord; }"
    picture = draw(vulkan_device, where, SIZE)
    assert picture.shape == (80, 96, 4)
    assert np.array_equal(picture[..., 0], np.broadcast_to(np.arange(96) + 0.5, (80, 96)))
    assert np.array_equal(picture[..., 1], np.broadcast_to((np.arange(80) + 0.5)[:, None], (80, 96)))
    assert (picture[..., 3] == 1.0).all()
