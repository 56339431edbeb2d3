"""Vertex caches and distances of surfaces against closed forms and brute force."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from common.mesh.metrics import cache_use, distances_to_triangles, hausdorff, surely_within
from tests.support.meshes import grid


def queue_misses(indices: np.ndarray, size: int) -> int:
    queue: deque[int] = deque(maxlen=size)
    misses = 0
    for vertex in indices.tolist():
        if vertex not in queue:
            queue.append(vertex)
            misses += 1
    return misses


def test_a_strip_misses_twice_and_then_once_per_triangle():
    triangles = np.arange(40)[:, None] + np.arange(3)
    use = cache_use(triangles.reshape(-1).astype(np.uint32))
    assert (use.misses, use.acmr, use.atvr) == (42, 42 / 40, 1.0)


def test_triangles_that_share_nothing_miss_three_times_each():
    use = cache_use(np.arange(90, dtype=np.uint32))
    assert (use.misses, use.acmr, use.atvr) == (90, 3.0, 1.0)


@pytest.mark.parametrize(("columns", "misses"), [(5, 6 * 31), (17, 18 * 2 * 30)])
def test_rows_of_a_grid_are_reused_if_they_fit_in_the_cache(columns, misses):
    # A row of 5 quads has 6 vertices: the row above is still there when the next one is drawn, and each vertex is
    # loaded once. With 18 vertices each has gone before it is asked for again, and every row of quads loads two rows.
    quads = grid(30, columns)[1]
    assert cache_use(quads).misses == queue_misses(quads, 16) == misses


@pytest.mark.parametrize("size", [1, 3, 16, 40])
def test_the_cache_is_a_queue(size):
    indices = np.random.default_rng(size).integers(0, 60, 3000).astype(np.uint32)
    use = cache_use(indices, size)
    assert use.misses == queue_misses(indices, size)
    assert use.atvr == use.misses / 60 and use.acmr == use.misses / 1000


def test_no_triangles_cost_nothing():
    assert cache_use(np.zeros(0, np.uint32)).misses == 0


def test_distances_to_a_triangle_have_closed_forms():
    triangle = np.array([[(0.0, 0, 0), (4, 0, 0), (0, 3, 0)]])
    points = np.array([(1, 1, 2), (-3, 0, -4), (2, -5, 0), (4, 3, 0), (7, -4, 0), (0.5, 0.5, 0)], float)
    # Above the inside; beyond a corner; beyond an edge; beyond the long edge 3x + 4y = 12; beyond a corner; inside.
    assert distances_to_triangles(points, triangle) == pytest.approx([2, 5, 5, 12 / 5, 5, 0], abs=1e-15)


def test_distances_equal_brute_force_in_a_crowd_of_triangles():
    rng = np.random.default_rng(3)
    triangles = rng.random((300, 1, 3)) + 0.2 * rng.random((300, 3, 3)) ** 3
    triangles[7] = triangles[7, 0]  # a point
    triangles[8, 2] = (triangles[8, 0] + triangles[8, 1]) / 2  # a line
    points = 1e3 + rng.normal(size=(20, 3))
    triangles += 1e3
    weights = rng.dirichlet((0.5, 0.5, 0.5), 1000)
    sampled = np.einsum("sc,tci->tsi", weights, triangles).reshape(-1, 3)
    brute = np.array([np.sqrt(((sampled - point) ** 2).sum(axis=1).min()) for point in points])
    alone = np.array([[distances_to_triangles(p[None], t[None])[0] for t in triangles] for p in points[:2]])
    exact = distances_to_triangles(points, triangles)
    assert np.array_equal(exact[:2], alone.min(axis=1))
    assert (exact <= brute).all() and (brute - exact).max() < 0.02


def test_parallel_squares_are_their_distance_apart_and_a_hole_is_seen_from_one_side():
    square, quads = grid(1, 1, height=0)
    above = square + np.float32((0, 0, 0.25))
    assert hausdorff(square, quads, above, quads, samples=50) == pytest.approx(0.25, rel=1e-12)
    assert hausdorff(square, quads, square, quads, samples=50) < 1e-15
    # Half of the square is missing: the corner (0, 1) is sqrt(1/2) from the other half's edge.
    assert hausdorff(square, quads, square, quads[:3], samples=50) == pytest.approx(0.5**0.5, rel=1e-12)
    assert surely_within(square, quads[:3], square, quads, 1e-9)
    assert not surely_within(square, quads, square, quads[:3], 0.7071)
    assert surely_within(square, quads, square, quads[:3], 0.7072)


def test_what_samples_may_miss_is_not_proven():
    # A needle of width 1e-3 on a large square: no sample of fifty would meet its tip if corners were left out.
    square, quads = grid(1, 1, height=0)
    needle = np.float32([(0.5, 0.5, 0), (0.501, 0.5, 0), (0.5, 0.5, 0.3)])
    both = np.concatenate([square, needle])
    indices = np.concatenate([quads, np.uint32([4, 5, 6])])
    assert not surely_within(both, indices, square, quads, 0.299)
    assert surely_within(both, indices, square, quads, 0.301)
    assert surely_within(square, quads, both, indices, 1e-6)
