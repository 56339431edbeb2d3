"""Refits on both backends: what has moved is hit as if built anew, and boxes are those of numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters import ch12
from chapters.ch12.pipelines.vulkan import CHAPTER
from chapters.ch12.rays.bvh import build, model, pack
from common.layouts import dtype, fill_instances
from tests.support.hierarchies import Tracer, icosphere, indexed, random_rays, rays_of, soup
from tests.support.kernels import kernels_on

pytestmark = [pytest.mark.variants("vulkan", "gl"), pytest.mark.feature("ray-tracing/software-bvh")]
FOLDER = CHAPTER / "rays" / "bvh"


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch12.__name__) as opened:
        yield opened


@pytest.fixture(scope="module")
def tracer(kernels, tmp_path_factory):
    return Tracer(kernels, model, tmp_path_factory.mktemp("rays"))


class Refitter:
    """Runs the kernels over `Buffers`, and returns others."""

    def __init__(self, kernels):
        self.kernels, self.constants = kernels, tuple(model.CONSTANTS.items())

    def _run(self, name, buffers, more, count, push=(0, 0, 0, 0), *defines):
        pipeline = self.kernels.pipeline(FOLDER / name, defines=(*self.constants, *defines))
        arrays = [buffers.nodes.view(np.uint32), buffers.triangles.view(np.uint32), buffers.instances, *more]
        nodes, triangles, instances = self.kernels.run(pipeline, arrays, (count,), np.array(push, np.uint32))[
            :3
        ]
        return replace(
            buffers,
            nodes=nodes.view(model.NODE),
            triangles=triangles.view(model.TRIANGLE),
            instances=instances,
        )

    def triangles(self, buffers, first, count, table, words, page=0):
        return self._run(
            "refit.comp", buffers, [table, words], count, (first, count, page, 0), ("TRIANGLES", 1)
        )

    def nodes(self, buffers, lists, upper=False):
        for list_ in lists:
            buffers = self._run("refit.comp", buffers, [list_], len(list_), (0, len(list_), upper, 0))
        return buffers

    def instances(self, buffers, records):
        slots = buffers.slots.view(np.uint32)
        buffers = self._run(
            "instances.comp", buffers, [records.view(np.uint32).reshape(-1), slots], len(buffers.slots)
        )
        levels = buffers.levels
        lists = [np.arange(a, b, dtype=np.uint32) for a, b in zip(levels[-2::-1], levels[:0:-1], strict=True)]
        return self.nodes(buffers, lists, upper=True)


@pytest.fixture(scope="module")
def refitter(kernels):
    return Refitter(kernels)


def page_of(meshes):
    """Return the words of a page with positions and indices of meshes, and the table of where they are."""
    parts, table, at = [], np.zeros((len(meshes), 8), np.uint32), 0
    for row, (positions, indices) in zip(table, meshes, strict=True):
        row[0], row[6] = at, at + positions.size
        parts += [positions.reshape(-1).view(np.uint32), indices.astype(np.uint32)]
        at += positions.size + indices.size
    return np.concatenate(parts), table


def moved(positions, amount):
    """Return positions (V, 3) after a wave went through them."""
    wave = np.sin(3 * positions[:, [1, 2, 0]].astype(np.float64) + 0.7)
    return np.float32(positions + amount * wave)


def test_deforming_meshes_are_hit_as_after_a_build(tracer, refitter):
    """Two meshes that bend, in two pages, and one at rest between them; one triangle folds up and another one opens."""
    rng = np.random.default_rng(1)
    sphere, bent = icosphere(2), indexed(soup(90, 2, 0.3))
    still = indexed(soup(30, 3, 0.3))
    meshes = [(sphere[0], sphere[1].reshape(-1)), still, bent]
    start = [positions.copy() for positions, _ in meshes]
    start[2][3:6] = start[2][3]  # no area yet
    trees = [
        pack.mesh_tree(positions, indices, mesh=number, deforming=number != 1)
        for number, (positions, (_, indices)) in enumerate(zip(start, meshes, strict=True))
    ]
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, :3, 3] = rng.uniform(-1, 1, (3, 3))
    buffers = pack.buffers(trees, matrices, [0, 1, 2])
    end = [moved(start[0], 0.3), start[1], moved(meshes[2][0], 0.2)]
    end[2][6:9] = np.nan
    end[2][9:12] = end[2][9]
    pages = [page_of([(end[0], meshes[0][1])]), page_of([(end[2], meshes[2][1])])]
    table = np.zeros((3, 8), np.uint32)
    table[0], table[2], table[2, 7] = pages[0][1][0], pages[1][1][0], 1
    fitted = buffers
    for page, (words, _) in enumerate(pages):
        fitted = refitter.triangles(fitted, 0, len(buffers.triangles), table.reshape(-1), words, page) if page else (
            refitter.triangles(fitted, 0, len(trees[0].triangles), table.reshape(-1), words, 0)
        )  # fmt: skip
    lists = pack.refit_lists([(int(buffers.roots[m]), trees[m].levels) for m in (0, 2)])
    assert len(lists) == max(len(trees[m].levels) for m in (0, 2)) - 1
    fitted = refitter.nodes(fitted, lists)
    # Boxes to the bit as numpy has them.
    for mesh in (0, 2):
        tree, root, first = trees[mesh], int(buffers.roots[mesh]), int(buffers.firsts[mesh])
        triangles = fitted.triangles[first : first + len(tree.triangles)]
        expected = tree.nodes.copy()
        pack.refit(expected, tree.levels, triangles)
        expected = pack.moved(expected, root, first)
        assert np.array_equal(fitted.nodes[root : root + len(expected)], expected)
    # The upper level, too, since boxes of meshes grew; at rest nothing else changes.
    records = np.zeros(3, dtype("Instance"))
    fill_instances(records, matrices, matrices, origin=(0, 0, 0), object_bounds=np.zeros((3, 2, 3)),
                   mesh=[0, 1, 2], material=0, visible=True)  # fmt: skip
    fitted = refitter.instances(fitted, records)
    anew = [pack.mesh_tree(positions, indices) for positions, (_, indices) in zip(end, meshes, strict=True)]
    anew = pack.buffers(anew, matrices, [0, 1, 2])
    assert anew.left_out == 2
    rays = rays_of(*random_rays(4000, 4, 2.5))
    got, expected, before = (tracer.trace(which, rays) for which in (fitted, anew, buffers))
    assert np.array_equal(got.instance, expected.instance) and np.array_equal(
        got.primitive, expected.primitive
    )
    assert np.array_equal(got.t, expected.t) and np.array_equal(got.back, expected.back)
    assert expected.hit.mean() > 0.4 and not np.array_equal(before.t, expected.t)
    opened = (got.instance == 2) & (got.primitive == 1)
    assert opened.any() and not ((before.instance == 2) & (before.primitive == 1)).any()
    assert not ((got.instance == 2) & np.isin(got.primitive, [2, 3])).any()


def test_moving_instances_are_hit_as_after_a_build(tracer, refitter):
    """Instances that turn, mirror, hide and appear; one whose matrix is no longer a matrix."""
    rng = np.random.default_rng(5)
    trees = [
        pack.mesh_tree(*indexed(soup(40, 1, 0.4))),
        pack.mesh_tree(np.zeros((0, 3)), np.zeros(0, np.uint32)),
    ]
    count = 50

    def places():
        matrices = np.tile(np.eye(4), (count, 1, 1))
        turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
        matrices[:, :3, :3] = turns * rng.uniform(0.2, 1.0, (count, 1, 3))
        matrices[:, :3, 3] = rng.uniform(-3, 3, (count, 3))
        return matrices

    before, after = places(), places()
    mesh_of = (np.arange(count) % 10 == 9).astype(int)
    mask = np.where(np.arange(count) % 3 == 0, 2, 1)
    buffers = pack.buffers(trees, before, mesh_of, mask=mask)
    after[7, :3, 1] = 0.0
    visible = rng.random(count) < 0.8
    records = np.zeros(count, dtype("Instance"))
    fill_instances(records, after, before, origin=(0, 0, 0), object_bounds=np.zeros((count, 2, 3)),
                   mesh=mesh_of, material=0, visible=visible)  # fmt: skip
    fitted = refitter.instances(buffers, records)
    anew = pack.buffers(trees, after, mesh_of, mask=np.where(visible, mask, 0))
    rays = rays_of(*random_rays(4000, 6, 5.0))
    for which in (0xFF, 1, 2):
        got, expected = tracer.trace(fitted, rays, which), tracer.trace(anew, rays, which)
        # The matrices' inverses differ by roundings, and so may rays along edges.
        same = (got.instance == expected.instance) & (got.primitive == expected.primitive)
        assert same.mean() > 0.998 and 0.1 < expected.hit.mean() < 0.9
        both = same & expected.hit
        assert np.allclose(got.t[both], expected.t[both], rtol=1e-4, atol=1e-5)
    shown = tracer.trace(fitted, rays).instance
    assert np.isin(shown[shown >= 0], np.flatnonzero(visible & (np.arange(count) != 7))).all()
    assert not np.array_equal(tracer.trace(buffers, rays).instance, shown)
    # The boxes of instances contain their corners, in float64.
    corners = trees[0].triangles
    corners = np.concatenate([corners[name] for name in "abc"]).astype(np.float64)
    for slot in fitted.slots:
        node, side = fitted.nodes[slot["box"] // 2], slot["box"] % 2
        low, high, i = node[f"low{side}"], node[f"high{side}"], slot["instance"]
        if visible[i] and mesh_of[i] == 0 and i != 7:
            world = corners @ np.float32(after[i, :3, :3]).astype(np.float64).T + after[i, :3, 3]
            assert (low <= world.min(axis=0)).all() and (high >= world.max(axis=0)).all()
            assert (high - low <= 1.5 * np.abs(after[i, :3, :3]).sum(axis=1) * 4).all()
        else:
            assert (low == np.inf).all() and (high == -np.inf).all()


def test_a_refit_of_nothing_moved_changes_nothing(refitter):
    positions, triangles = icosphere(2)
    indices = triangles.reshape(-1)
    tree = pack.mesh_tree(positions, indices, deforming=True)
    buffers = pack.buffers([tree], np.eye(4)[None], [0])
    words, table = page_of([(positions, indices)])
    fitted = refitter.triangles(buffers, 0, len(triangles), table.reshape(-1), words)
    fitted = refitter.nodes(fitted, pack.refit_lists([(0, tree.levels)]))
    assert np.array_equal(fitted.nodes, buffers.nodes) and np.array_equal(fitted.triangles, buffers.triangles)


def test_a_refit_costs_more_than_a_build_where_much_has_moved():
    """The figure by which a rebuild is due: the cost of the tree's boxes, against that of a tree built anew."""
    corners = soup(500, 7, 0.05)
    order = np.random.default_rng(8).permutation(500)
    tree = pack.mesh_tree(*indexed(corners), deforming=True)
    built = build.cost(tree.nodes)
    assert built == pytest.approx(
        build.sah_cost(build.build(corners.min(axis=1), corners.max(axis=1))), rel=1e-6
    )
    jumbled = tree.triangles.copy()
    for name in "abc":
        jumbled[name] = tree.triangles[name][order]
    nodes = tree.nodes.copy()
    pack.refit(nodes, tree.levels, jumbled)
    assert build.cost(nodes) > 3 * built
