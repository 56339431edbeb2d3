"""Many lights: the tree by which a vertex of a path draws one of them, and pictures that it lights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch12.paths import light_tree
from chapters.ch12.scene.packing import LIGHT, LIGHT_KINDS
from tests.support.path_pictures import assert_agrees, assert_mean, opened, runs_of, z_scores
from tests.support.path_scenes import ABOVE, lit_yard
from tests.support.shadows import point, spot

FEW = light_tree.FEW


def lamps(count, seed=5):
    """Return LIGHT records of lamps in a hall: some are dark, some have no end, some are in one place."""
    rng = np.random.default_rng(seed)
    records = np.zeros(count, LIGHT)
    records["position"] = rng.uniform(-20.0, 20.0, (count, 3))
    records["position"][: count // 4] = records["position"][0]
    records["color"] = 10.0 ** rng.uniform(-8.0, 4.0, (count, 3))
    records["color"][rng.random(count) < 0.1] = 0.0
    records["inverse_range2"] = np.where(
        rng.random(count) < 0.8, 1.0 / rng.uniform(1.0, 9.0, count) ** 2, 0.0
    )
    records["end_distance2"] = np.where(rng.random(count) < 0.8, rng.uniform(1.0, 90.0, count), 3e38)
    records["kind"] = rng.integers(0, 2, count)
    return records


def parts(tree):
    """Return the (2 L, 8) float32 nodes and the (L,) lights of leaves."""
    leaves = light_tree.leaves_of(tree)
    return tree[: 4 * leaves].view(np.float32).reshape(-1, 8), tree[4 * leaves :].reshape(-1)


@pytest.mark.parametrize("count", [FEW + 1, 64, 100, 777])
def test_nodes_hold_all_that_is_below_them(count):
    records = lamps(count + 2)
    records["kind"][:2] = LIGHT_KINDS["directional"]
    tree = light_tree.light_tree(records, 2)
    assert len(tree) == light_tree.room(count)
    nodes, numbers = parts(tree)
    leaves = len(numbers)
    assert leaves == light_tree.leaves_for(count) and sorted(numbers) == list(range(2, leaves + 2))
    assert np.isfinite(nodes).all() and (nodes[:, 3] >= 0.0).all()
    shines = np.zeros(leaves, bool)
    own = numbers < count + 2
    shines[own] = records["color"][numbers[own]].max(axis=1) > 0.0
    assert ((nodes[leaves:, 3] > 0.0) == shines).all()
    for leaf in np.flatnonzero(shines):
        record, node = records[numbers[leaf]], leaves + leaf
        ends = float(record["end_distance2"]), 1.0 / max(float(record["inverse_range2"]), 1e-38)
        while node:
            low, power, high, reach2 = np.split(nodes[node], (3, 4, 7))
            assert (low <= record["position"]).all() and (record["position"] <= high).all()
            assert power > 0.0 and reach2 >= min(*ends, 1e37)
            node //= 2
    below = nodes[leaves:, 3].reshape(2, -1).sum(axis=1)
    assert nodes[2:4, 3] == pytest.approx(below, rel=1e-5)
    strong = np.flatnonzero(shines)[np.argsort(nodes[leaves:, 3][shines])[-2:]]
    colors = records["color"][numbers[strong]].max(axis=1)
    assert np.divide(*nodes[leaves + strong, 3]) == pytest.approx(np.divide(*colors), rel=1e-5)


def test_halves_are_apart():
    """Lights in two halls: each hall is one side of the root."""
    records = lamps(64)
    records["position"][:, 1] = np.where(np.arange(64) % 2, 500.0, -500.0)
    records["color"] = 1.0
    nodes, _ = parts(light_tree.light_tree(records, 0))
    assert nodes[2, 5] == -500.0 and nodes[3, 1] == 500.0


def test_few_lights_need_no_tree():
    assert light_tree.room(FEW) == 0 and not len(light_tree.light_tree(lamps(FEW), 0))
    assert not len(light_tree.light_tree(lamps(3), 3))


# --- pictures ---


def many():
    """Return a yard with a box and 40 lights of all kinds, most of which reach a part of it."""
    rng = np.random.default_rng(11)
    more = []
    for number in range(37):
        place = (*rng.uniform(-1.4, 1.4, 2), rng.uniform(0.6, 1.8))
        eye = place[0], place[2], place[1]
        reach = math.inf if number % 5 == 0 else rng.uniform(0.8, 2.5)
        below = eye[0] + rng.uniform(-0.5, 0.5), 0.0, eye[2] + rng.uniform(-0.5, 0.5)
        candela = 10.0 ** rng.uniform(-1.0, 1.0)
        made = (
            spot(eye, below, math.radians(25), candela, reach) if number % 3 else point(eye, candela, reach)
        )
        more.append(made)
    return lit_yard(*more)


@pytest.fixture(scope="module")
def yard(chapter):
    """Return a renderer of `many`, whose light is reflected once: by a ray to each light without any noise."""
    with opened(chapter, many(), path_bounces=1, path_filter="centre") as renderer:
        yield renderer


@pytest.mark.variants("vulkan", "gl", long=("gl",))
@pytest.mark.feature("path-tracer/core")
def test_one_of_many_lights_has_the_mean_of_all(yard):
    (picture,) = runs_of(yard, ABOVE, count=2)
    assert np.array_equal(picture[0], picture[1]) and picture[0].max() > 0.0
    (one,) = runs_of(yard, ABOVE, count=24, path_lights="one", path_samples=16)
    assert_agrees(z_scores(one, picture[0], block=2))
    assert_mean(one, picture[0], 0.01)


@pytest.mark.variants("vulkan")
def test_the_tree_follows_lights_that_change(yard):
    """Lights that reach farther than before: the tree as it was leaves them out where they add light now."""
    scene, before = yard.scene, list(yard.scene.lights)
    (near,) = runs_of(yard, ABOVE, count=1)
    with scene.edit() as edit:
        for number, lamp in enumerate(before):
            edit.set_light(number, replace(lamp, range=math.inf))
    try:
        (far,) = runs_of(yard, ABOVE, count=1)
        assert far.mean() > 1.1 * near.mean()
        (one,) = runs_of(yard, ABOVE, count=24, path_lights="one", path_samples=16)
        assert_mean(one, far[0], 0.01)
    finally:
        with scene.edit() as edit:
            for number, lamp in enumerate(before):
                edit.set_light(number, lamp)
