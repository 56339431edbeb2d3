"""Frustum culling on the CPU: against a separating-axis test, and against what planes alone find."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from chapters.ch06.culling.model import visible_boxes
from common.numerics.transforms import frustum_planes, look_at, orthographic, perspective

cpu_frustum = pytest.mark.feature("culling/cpu-frustum")
INFINITE = np.inf

LENSES = {
    "perspective": perspective(1.0, 1.6, 0.1),
    "wide": perspective(2.4, 2.0, 0.5),
    "orthographic": orthographic(3.0, 1.5, 0.5, 60.0),
}
every_lens = pytest.mark.parametrize("name", LENSES)


def views(name, count, seed=1, far=0.0):
    """Return `clip_from_world` matrices: the first along the axes of the world, the others in any direction."""
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(count, 3)) + far * rng.uniform(-1, 1, (count, 3))
    directions = np.concatenate([np.eye(3)[:2], rng.normal(size=(count - 2, 3))])
    return [
        (eye, LENSES[name] @ look_at(eye, eye + direction, (0.3, 1.0, 0.2)))
        for eye, direction in zip(eyes, directions, strict=True)
    ]


def boxes_around(eye, count, seed):
    """Return corners of boxes of many sizes and shapes, most of them larger than their distance."""
    rng = np.random.default_rng(seed)
    middle = eye + rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-1, 2, (count, 1))
    half = 10.0 ** rng.uniform(-2, 2, (count, 1)) * rng.uniform(0.01, 1, (count, 3))
    return middle - half, middle + half


class Frustum:
    """A frustum as points and rays, from its planes: an edge is where two planes meet, a corner where three do."""

    def __init__(self, clip_from_world):
        planes = frustum_planes(clip_from_world)
        self.normals = planes[:, :3]
        pairs = [(0, 2), (0, 3), (1, 2), (1, 3)]
        ends = [4, 5][: len(planes) - 4]
        meet = [(*pair, end) for pair in pairs for end in ends]
        self.points = np.array(
            [np.linalg.solve(planes[list(three), :3], -planes[list(three), 3]) for three in meet]
        )
        edges = np.array([np.cross(self.normals[a], self.normals[b]) for a, b in pairs])
        self.edges = edges * np.sign(edges @ self.normals[4])[:, None]
        across = np.array([np.cross(self.normals[side], self.normals[4]) for side in (0, 2)])
        self.edge_axes = np.concatenate([self.edges, across])
        self.rays = self.edges if len(ends) == 1 else np.zeros((0, 3))

    def interval(self, axis):
        """Return from where to where the frustum reaches along an axis."""
        along, rays = self.points @ axis, self.rays @ axis
        low = -INFINITE if (rays < -1e-12).any() else along.min()
        return low, INFINITE if (rays > 1e-12).any() else along.max()


def gap(low, high, frustum):
    """Return (N,) the widest gap between boxes and the frustum along any separating axis; <= 0 where they meet.

    Two convex bodies are apart exactly if they are so along a normal of one of them, or along a cross product of an
    edge of each (Gottschalk, Lin and Manocha 1996).
    """
    box_axes = np.eye(3)
    crosses = [np.cross(a, b) for a, b in itertools.product(box_axes, frustum.edge_axes)]
    widest = np.full(len(low), -INFINITE)
    for axis in (*box_axes, *frustum.normals, *crosses):
        length = np.linalg.norm(axis)
        if length < 1e-9:
            continue
        axis = axis / length
        upper = high @ np.maximum(axis, 0) + low @ np.minimum(axis, 0)
        lower = low @ np.maximum(axis, 0) + high @ np.minimum(axis, 0)
        begin, end = frustum.interval(axis)
        widest = np.maximum(widest, np.maximum(begin - upper, lower - end))
    return widest


def outside_planes(low, high, clip_from_world):
    """Return whether all eight corners are outside of one plane, corner by corner."""
    corners = np.stack(
        [np.where(pick, high, low) for pick in itertools.product((False, True), repeat=3)], axis=1
    )
    planes = frustum_planes(clip_from_world)
    return (corners @ planes[:, :3].T + planes[:, 3] < 0).all(axis=1).any(axis=1)


@cpu_frustum
@every_lens
def test_no_box_that_meets_the_frustum_is_culled_and_faces_find_more_than_planes(name):
    """60,000 boxes for all lenses together; planes alone keep many boxes that a separating axis tells apart."""
    kept = kept_by_planes = apart = 0
    for seed, (eye, clip_from_world) in enumerate(views(name, 20)):
        low, high = boxes_around(eye, 1000, seed)
        visible = visible_boxes(low, high, clip_from_world)
        planes_alone = ~outside_planes(low, high, clip_from_world)
        separated = gap(low, high, Frustum(clip_from_world))
        assert visible[separated <= 0].all(), "a box that meets the frustum was culled"
        assert not (visible & ~planes_alone).any(), "planes alone cull what was kept"
        clearly = separated > 1e-9 * np.abs(high).max(axis=1)
        kept += (visible & clearly).sum()
        kept_by_planes += (planes_alone & clearly).sum()
        apart += clearly.sum()
    assert kept < kept_by_planes, "the faces of boxes find nothing"
    assert kept < 0.015 * apart


@cpu_frustum
@every_lens
def test_far_from_the_origin_no_box_that_meets_the_frustum_is_culled(name):
    for seed, (eye, clip_from_world) in enumerate(views(name, 6, seed=2, far=1e5)):
        low, high = boxes_around(eye, 1000, seed)
        visible = visible_boxes(low, high, clip_from_world)
        separated = gap(low, high, Frustum(clip_from_world))
        assert visible[separated <= 0].all()
        assert visible[separated > 1e-3].mean() < 0.3


def test_boxes_that_are_no_number_are_visible():
    _, clip_from_world = views("perspective", 3)[2]
    low, high = boxes_around(np.full(3, 1e4), 60, 3)
    low, high = low - 1e3, high - 1e3
    assert not visible_boxes(low, high, clip_from_world).all()
    for number in range(60):
        (low if number % 2 else high)[number, number % 3] = np.nan
    assert visible_boxes(low, high, clip_from_world).all()


@every_lens
def test_a_box_around_everything_a_point_inside_and_no_boxes(name):
    eye, clip_from_world = views(name, 3)[2]
    frustum = Frustum(clip_from_world)
    ahead = frustum.edges.sum(axis=0)
    inside = frustum.points.mean(axis=0) + 1e-3 * ahead
    low = np.array([[-1e6] * 3, inside, [-INFINITE] * 3])
    high = np.array([[1e6] * 3, inside, [INFINITE] * 3])
    assert visible_boxes(low, high, clip_from_world).all()
    assert visible_boxes(np.zeros((0, 3)), np.zeros((0, 3)), clip_from_world).shape == (0,)
    behind = (eye - ahead)[None]
    assert not visible_boxes(behind, behind, clip_from_world).any()


@cpu_frustum
def test_a_frustum_that_is_turned_around_loses_boxes_which_the_separating_axes_notice():
    eye, clip_from_world = views("perspective", 4)[3]
    low, high = boxes_around(eye, 2000, 9)
    turned = clip_from_world.copy()
    turned[3] *= -1
    lost = ~visible_boxes(low, high, turned) & (gap(low, high, Frustum(clip_from_world)) <= 0)
    assert lost.sum() > 20
