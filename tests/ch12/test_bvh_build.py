"""The builder: every primitive once, boxes that are tight, leaves and depth within their bounds, whatever comes in."""

from __future__ import annotations

import time

import numpy as np
import pytest

from chapters.ch12.rays.bvh import build, model, morton, pack
from tests.support.hierarchies import icosphere, indexed, soup

pytestmark = pytest.mark.feature("ray-tracing/software-bvh")


def boxes_of(corners):
    return corners.min(axis=1), corners.max(axis=1)


def check(tree, low, high, largest=model.LEAF_LARGEST):
    """Walk the tree node by node and hold it to its boxes; return the depth at which it has its last leaf."""
    assert sorted(tree.order.tolist()) == list(range(len(low)))
    covered = np.zeros(len(low), int)

    def inside(child, own_low, own_high, depth):
        if child < 0:
            first, count = tree.first[~child], tree.count[~child]
            assert 1 <= count <= largest or len(low) == 0
            listed = tree.order[first : first + count]
            covered[listed] += 1
            assert np.array_equal(low[listed].min(axis=0), own_low)
            assert np.array_equal(high[listed].max(axis=0), own_high)
            return depth
        assert np.array_equal(tree.low[child].min(axis=0), own_low)
        assert np.array_equal(tree.high[child].max(axis=0), own_high)
        return max(
            inside(tree.children[child, side], tree.low[child, side], tree.high[child, side], depth + 1)
            for side in range(2)
        )

    depth = 0
    if len(low) > largest:
        depth = max(
            inside(tree.children[0, side], tree.low[0, side], tree.high[0, side], 1) for side in range(2)
        )
        assert depth == tree.depth <= model.DEPTH_UPPER
        assert tree.levels[-1] == len(tree.children)
        assert (covered == 1).all()
    return depth


@pytest.mark.parametrize("largest", [1, 2, 4])
@pytest.mark.parametrize("count", [0, 1, 2, 4, 5, 6, 17, 64, 700])
def test_trees_of_random_triangles(count, largest):
    low, high = boxes_of(soup(count, count, 0.1))
    tree = build.build(low, high, largest)
    check(tree, low, high, largest)
    again = build.build(low, high, largest)
    assert np.array_equal(tree.order, again.order) and np.array_equal(tree.children, again.children)


def test_all_in_one_place_is_split_in_the_middle():
    low, high = np.zeros((1000, 3), np.float32), np.ones((1000, 3), np.float32)
    assert check(build.build(low, high), low, high) == 8  # 1000 = 4 * 2^8, less some


def test_depth_is_bounded_where_every_split_would_take_off_one():
    """Places whose distances halve: each split puts one aside, until the levels that are left must be even ones."""
    for count in (60, 100, 2000):
        place = np.float32(2.0) ** -np.arange(count, dtype=np.float32) if count < 120 else np.float32(
            1.3 ** -np.minimum(np.arange(count), 300.0)
        )  # fmt: skip
        low = np.stack([place, np.zeros(count), np.zeros(count)], axis=1).astype(np.float32)
        tree = build.build(low, low.copy(), 1)
        depth = check(tree, low, low, 1)
        assert depth > 11
    assert build.build(low[:60] + 0, low[:60] + 0, 1).depth <= model.DEPTH_UPPER


def test_extreme_boxes():
    """From the smallest numbers to 1e18, flat ones, and many that are alike."""
    rng = np.random.default_rng(3)
    centre = (rng.choice([-1, 1], (500, 3)) * 10.0 ** rng.uniform(-37, 17.9, (500, 3))).astype(np.float32)
    centre[100:200] = centre[100]
    centre[200:300, 1] = 0.0
    half = np.abs(centre) * np.float32(1e-3)
    with np.errstate(all="raise", under="ignore"):
        tree = build.build(centre - half, centre + half)
    check(tree, centre - half, centre + half)


def halves_cost(low, high):
    """Return the cost of a tree that splits a list in the middle, by the formula, node by node."""

    def area(low, high):
        x, y, z = (high.max(axis=0) - low.min(axis=0)).astype(np.float64)
        return x * y + y * z + z * x

    def cost(low, high):
        if len(low) <= model.LEAF_LARGEST:
            return area(low, high) * len(low)
        half = len(low) // 2
        return area(low, high) + cost(low[:half], high[:half]) + cost(low[half:], high[half:])

    return cost(low, high) / area(low, high)


@pytest.mark.parametrize(
    "corners", [soup(2000, 1, 0.03), icosphere(4)[0][icosphere(4)[1]]], ids=["soup", "sphere"]
)
def test_a_tree_is_better_than_halves(corners):
    """The heuristic against lists in Morton order that are split in the middle: at least a tenth less."""
    low, high = boxes_of(corners)
    curve = morton.order(corners.mean(axis=1))
    halves = halves_cost(low[curve], high[curve])
    assert build.sah_cost(build.build(low, high)) < 0.9 * halves


SIZES = (0, 1, 700, 3, 4, 5, 0, 17, 3000, 2, 64, 65, 0)
"""Of many lists: none, those of one leaf, and deep ones between shallow ones."""


@pytest.mark.parametrize("largest", [1, 2, 4])
def test_trees_that_are_built_together_are_those_built_alone(largest):
    lists = [
        boxes_of(soup(count, count, 0.1) * np.float32(10.0 ** (at % 7 - 3))) for at, count in enumerate(SIZES)
    ]
    lists.append((np.zeros((200, 3), np.float32), np.ones((200, 3), np.float32)))  # split in the middle
    low, high = (np.concatenate(parts) for parts in zip(*lists, strict=True))
    together = build.build_all(low, high, [len(part) for part, _ in lists], largest)
    for tree, (low, high) in zip(together, lists, strict=True):
        check(tree, low, high, largest)
        if 0 < len(low) <= largest:
            assert tree.children.tolist() == [[~0, ~1]] and tree.count.tolist() == [len(low), 0]
        alone = build.build(low, high, largest)
        assert tree.levels == alone.levels
        for name in ("order", "children", "low", "high", "first", "count"):
            assert np.array_equal(getattr(tree, name), getattr(alone, name)), name


@pytest.mark.parametrize("batch", [1, 100, pack.BATCH])
def test_meshes_that_are_built_together_are_those_built_alone(monkeypatch, batch):
    """Nodes and triangles to the bit, with triangles left out and kept, however many are built at once."""
    monkeypatch.setattr(pack, "BATCH", batch)
    meshes = []
    for count in SIZES:
        corners = soup(count, count, 0.1)
        corners[: count // 5, 1] = corners[: count // 5, 0]  # no area
        corners[count // 2 : count // 2 + count // 9, 2, 1] = np.nan
        meshes.append(indexed(corners))
    deforming = [1, 2, 6, 7]
    together = pack.mesh_trees(meshes, deforming)
    for mesh, (tree, parts) in enumerate(zip(together, meshes, strict=True)):
        alone = pack.mesh_tree(*parts, mesh=mesh, deforming=mesh in deforming)
        for name in ("nodes", "triangles", "box"):
            assert getattr(tree, name).tobytes() == getattr(alone, name).tobytes(), (mesh, name)
        assert (tree.levels, tree.left_out) == (alone.levels, alone.left_out)
        kept = len(parts[1]) // 3 - (0 if mesh in deforming else tree.left_out)
        assert len(tree.triangles) == kept
        assert (tree.triangles["flags"] == 0).sum() == len(parts[1]) // 3 - tree.left_out
    assert sum(tree.left_out for tree in together) > 500 and pack.mesh_trees([]) == []


def test_morton_order_follows_the_curve():
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    codes = morton.codes(cells.astype(np.float32), bits=3)
    plain = [
        sum(
            ((int(value) >> bit) & 1) << (3 * bit + 2 - axis)
            for axis, value in enumerate(cell)
            for bit in range(3)
        )
        for cell in cells
    ]
    assert codes.tolist() == plain
    jumble = np.random.default_rng(1).permutation(len(cells))
    assert np.array_equal(
        cells[jumble][morton.order(cells[jumble].astype(np.float32))], cells[np.argsort(plain)]
    )
    odd = np.float32([(np.nan, 0, 0), (1, 1, 1), (0, 0, 0), (np.inf, 0, 0), (1, 1, 1)])
    assert morton.order(odd).tolist() == [0, 2, 3, 1, 4]
    assert morton.order(odd[:1]).tolist() == [0] and len(morton.order(odd[:0])) == 0


def test_what_is_too_large_is_refused():
    with pytest.raises(ValueError, match=r"16777217 instances is too large for rays: they know 2\^24"):
        pack.check_sizes((1 << 24) + 1, 1)
    with pytest.raises(ValueError, match=r"triangles are too large for rays: they know 2\^29"):
        pack.check_sizes(1, 1 << 29)
    pack.check_sizes(1 << 24, 1 << 28)


@pytest.mark.long
@pytest.mark.needs("embreex")
@pytest.mark.parametrize("small", [False, True], ids=["one mesh", "200 meshes"])
def test_100_000_triangles_take_less_than_thrice_embree_s_time(small):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    positions, triangles = icosphere(6)
    positions = np.float32(positions * (1 + 0.02 * np.random.default_rng(1).normal(size=(len(positions), 1))))
    corners = np.concatenate([positions[triangles], soup(100_000 - len(triangles), 2, 0.01)])
    meshes = [indexed(part) for part in (np.split(corners, 200) if small else [corners])]
    ray = np.zeros((1, 3), np.float32), np.float32([(0, 0, 1)])

    def ours():
        pack.mesh_trees(meshes)

    def theirs():
        for positions, indices in meshes:
            scene = rtcore_scene.EmbreeScene()
            TriangleMesh(scene, positions, indices.reshape(-1, 3).astype(np.int32))
            scene.run(*ray)

    # Of the process's own time, by turns: other programs on the machine count for neither.
    times = {ours: [], theirs: []}
    for _ in range(5):
        for build_ in times:
            begin = time.process_time()
            build_()
            times[build_].append(time.process_time() - begin)
    assert min(times[ours]) < 3 * min(times[theirs])
