"""The front of a box as planes, `front_planes` of `shaders/bounds.glsl`, on both backends: never too far, and tight."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaders.test_bounds import (
    BOUNDS,
    BOX,
    NEAR,
    PICTURE,
    box_inputs,
    boxes,
    drawn,
    every_lens,
    heights_px,
    lens,
    triangles,
)
from tests.support.either import evaluate
from tests.twins import bounds as twin

FRONTS = f"""
    mat3 front = front_planes({BOX}, rounding);
    depth = front_depth(front, low, high);
    known = uint(box_footprint({BOX}, rounding).known);
"""
FRONT_OUTPUTS = {"depth": "float", "known": "uint"}


def front_depths(device, parts, low, high, rounding=None):
    """Return (N,) the nearest depth that the fronts of boxes allow in rectangles of ndc, and whether it may be used."""
    rounding = np.zeros((len(low), 4), np.float32) if rounding is None else rounding
    inputs = {**box_inputs(parts), "rounding": rounding, "low": np.float32(low), "high": np.float32(high)}
    got = evaluate(device, BOUNDS, FRONTS, inputs, FRONT_OUTPUTS)
    return got["depth"], got["known"] != 0


def points_in(rng, parts, on_faces=True):
    """Return (N, 4) a random point of each box in clip space; most are on a face."""
    factors = rng.uniform(-1, 1, (len(parts[0]), 3))
    if on_faces:
        number = np.arange(len(factors))
        factors[number, rng.integers(0, 3, len(factors))] = rng.choice([-1.0, 1.0], len(factors))
    exact = [part.astype(np.float64) for part in parts]
    return exact[0] + sum(factors[:, [i]] * exact[1 + i] for i in range(3))


@every_lens
def test_no_point_of_a_box_is_nearer_than_its_front(either_device, name):
    """Corners that may be off by a rounding are moved by it; the rectangles hold the point, and are often larger."""
    parts = boxes(name)
    parts[3][::9] = np.where(parts[3][::9] != 0, np.float32(1e-44), 0)  # flat, but for the smallest numbers
    rng = np.random.default_rng(21)
    rounding = np.float32(np.abs(parts[0]) * 10.0 ** rng.uniform(-7, -2, (len(parts[0]), 1)))
    rounding[::2] = 0.0
    rounding[:, 2] *= name == "orthographic"  # in a perspective view z is `near`, and exact
    bounded = 0
    for _ in range(6):
        point = points_in(rng, parts)
        point += rounding * rng.uniform(-1, 1, point.shape)
        ndc = point[:, :3] / point[:, 3:]
        room = 10.0 ** rng.uniform(-6, 0, (len(ndc), 2)) * rng.integers(0, 2, (len(ndc), 1))
        low = ndc[:, :2] - room * rng.random((len(ndc), 2))
        high = low + np.maximum(room, np.abs(low) * 1e-6 + 1e-7)
        high, low = np.maximum(high, ndc[:, :2] + 1e-6), np.minimum(low, ndc[:, :2] - 1e-6)
        depth, known = front_depths(either_device, parts, low, high, rounding)
        assert (depth >= ndc[:, 2])[known].all()
        bounded += (depth < 1.5)[known].mean() / 6
    assert bounded == 0 if name == "orthographic" else bounded > 0.5


@pytest.mark.parametrize("name", ["perspective", "narrow", "wide"])
def test_the_front_of_a_box_is_that_of_its_faces(either_device, name):
    """Where a ray enters a box, in float64: the bound is as near, but for what a rasteriser may add."""
    parts = boxes(name)
    parts = [part[len(parts[0]) // 8 :] for part in parts]  # not the flat ones
    rng = np.random.default_rng(22)
    point = points_in(rng, parts)
    ndc = point[:, :3] / point[:, 3:]
    exact = [part.astype(np.float64) for part in parts]
    corners = twin.box_corners(*exact)
    depths = corners[..., 2] / corners[..., 3]
    # In (x, y, w) the ray is a line through 0: the box in units of its half axes, entered at the farthest plane.
    own = np.stack([part[:, [0, 1, 3]] for part in exact[1:]], axis=2)
    ray = np.c_[ndc[:, :2], np.ones(len(ndc))]
    inverse = np.linalg.inv(own)
    begin = -(inverse @ exact[0][:, [0, 1, 3], None])[..., 0]
    along = (inverse @ ray[..., None])[..., 0]
    with np.errstate(divide="ignore"):
        enter = np.minimum((-1 - begin) / along, (1 - begin) / along).max(axis=1)  # w where the ray enters
    truth = exact[0][:, 2] / enter
    got, known = front_depths(either_device, parts, ndc[:, :2], ndc[:, :2])
    drawn_more = np.ptp(depths, axis=1) / 60 + 1e-4 * np.abs(truth)
    sure = known & (enter > 0) & (corners[..., 3].min(axis=1) > 0.02 * corners[..., 3].max(axis=1))
    # Faces that are seen along an edge have planes without numbers that can be trusted; few are.
    assert (got < truth + drawn_more + 1e-5 * depths.max(axis=1))[sure].mean() > 0.98 and sure.sum() > 300
    assert (got > truth + np.ptp(depths, axis=1) / 65)[sure].all()


def test_what_a_rasteriser_draws_is_behind_the_front(vulkan_device):
    """Each triangle is half of a box without a thickness; its pixels are rectangles, widened by a snapped corner."""
    rng, pixels, tighter = np.random.default_rng(23), 0, 0
    matrix = lens("perspective")
    size = np.array(PICTURE)
    edge = 1 / 256 + 1e-6 * size
    for _ in range(4):
        clip = (triangles(rng, 600) @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)
        exact = clip.astype(np.float64)
        clip = clip[(exact[..., 3] > NEAR).all(axis=1) & (heights_px(exact) > 0.2)]
        a, b, c = np.moveaxis(clip.astype(np.float64), 1, 0)
        parts = [np.float32(part) for part in ((b + c) / 2, (b - a) / 2, (c - a) / 2, 0 * a)]
        which, pixel, depth, _ = drawn(vulkan_device, clip)
        low, high = ((pixel + side) / size * 2 - 1 for side in (-edge, 1 + edge))
        parts = [part[which] for part in parts]
        # The half axes in float32 move the corners of the triangle by an ulp; a rounding says so.
        rounding = np.float32(np.abs(np.stack(parts)).max(axis=0) * 2.0**-22)
        bound, known = front_depths(vulkan_device, parts, low, high, rounding)
        assert (depth <= bound)[known].all()
        pixels += known.sum()
        tighter += (bound < 1.5)[known].sum()
    assert pixels > 30_000 and tighter > 0.8 * pixels
