"""The builder on the GPU, on both backends: hits against brute force, order against numpy, and one result alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters import ch12
from chapters.ch12.pipelines.vulkan import CHAPTER
from chapters.ch12.rays.bvh import build, model, morton, pack
from chapters.ch12.rays.bvh.fast import Rebuilt
from tests.support.hierarchies import Tracer, indexed, random_rays, rays_of, soup
from tests.support.kernels import kernels_on
from tests.twins.rays import nearest

pytestmark = [pytest.mark.variants("vulkan", "gl"), pytest.mark.feature("ray-tracing/software-bvh")]
FOLDER = CHAPTER / "rays" / "bvh"


class Rebuilder:
    """Runs the steps of a rebuild, one dispatch at a time, and keeps what they leave."""

    def __init__(self, kernels):
        self.kernels, self.constants = kernels, tuple(model.CONSTANTS.items())

    def run(self, mesh, buffers, steps, table, words, pairs=None):
        """Return `Buffers` and the sorted pairs after all steps."""
        sizes = mesh.sizes
        pairs = np.zeros(sizes["pairs"] // 4, np.uint32) if pairs is None else pairs
        other, counts = np.zeros_like(pairs), np.zeros(sizes["counts"] // 4, np.uint32)
        halves = np.zeros(sizes["halves"] // 4, np.uint32)
        nodes, triangles = buffers.nodes.view(np.uint32), buffers.triangles.view(np.uint32)
        for step in steps:
            defines = (*self.constants, *([(step.part, 1)] if step.part else []))
            pipeline = self.kernels.pipeline(FOLDER / step.file, defines=defines)
            push = np.array(step.push, np.uint32)
            if step.file == "sort.comp":
                between = [other, pairs] if step.sorts else [pairs, other]
                between = [*between, counts]
                between = self.kernels.run(pipeline, between, (step.invocations,), push)
                counts = between[2]
                other, pairs = between[:2] if step.sorts else between[1::-1]
            else:
                more = [table, words] if step.file == "refit.comp" else [pairs, halves]
                arrays = [nodes, triangles, buffers.instances, *more]
                arrays = self.kernels.run(pipeline, arrays, (step.invocations,), push)
                nodes, triangles = arrays[:2]
                if step.file == "fast.comp":
                    pairs, halves = arrays[3:]
        return replace(buffers, nodes=nodes.view(model.NODE), triangles=triangles.view(model.TRIANGLE)), pairs

    def cost(self, buffers, root, count):
        pipeline = self.kernels.pipeline(FOLDER / "quality.comp", defines=self.constants)
        arrays = [buffers.nodes.view(np.uint32), buffers.triangles.view(np.uint32), buffers.instances]
        push = np.array([root, count, 1, 0], np.uint32)
        return float(self.kernels.run(pipeline, [*arrays, np.zeros(2, np.float32)], (1,), push)[3][1])


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch12.__name__) as opened:
        yield opened


@pytest.fixture(scope="module")
def tracer(kernels, tmp_path_factory):
    return Tracer(kernels, model, tmp_path_factory.mktemp("rays"))


def walk(nodes, root, first, count):
    """Hold a hierarchy to its triangles: every one of them once, in leaves; return the depth."""
    covered, deepest, open_ = np.zeros(count, int), 0, [(root, 1)]
    while open_:
        node, depth = open_.pop()
        deepest = max(deepest, depth)
        for side in "01":
            code = int(nodes[f"child{side}"][node])
            if code == model.NO_CHILD:
                assert nodes[f"low{side}"][node, 0] == np.inf
            elif code & model.LEAF:
                begin = (code & ((1 << model.COUNT_SHIFT) - 1)) - first
                covered[begin : begin + (code >> model.COUNT_SHIFT & 3) + 1] += 1
            else:
                open_.append((code, depth + 1))
    assert (covered == 1).all()
    return deepest


def words_of(positions, indices):
    table = np.zeros(8, np.uint32)
    table[6] = positions.size
    return np.concatenate([positions.reshape(-1).view(np.uint32), indices.astype(np.uint32)]), table


COUNTS = [1, *(pytest.param(count, marks=pytest.mark.long) for count in (3, 4, 5, 8, 9)), 33, 1000]
"""Triangles; a leaf has up to four."""


@pytest.mark.parametrize("count", COUNTS)
def test_a_rebuilt_mesh_is_hit_as_by_brute_force(kernels, tracer, count):
    rebuilder = Rebuilder(kernels)
    start, end = soup(count, 1, 0.1), soup(count, count + 1, 0.1 if count > 100 else 0.7)
    end[0] = np.nan if count == 33 else end[0]
    positions, indices = indexed(end)
    still = pack.mesh_tree(*indexed(soup(7, 3, 0.01) + np.float32(50)))
    tree = pack.mesh_tree(*indexed(start), mesh=0, deforming=True)
    buffers = pack.buffers([still, tree], np.tile(np.eye(4), (2, 1, 1)), [0, 1])
    root, first = int(buffers.roots[1]), int(buffers.firsts[1])
    mesh = Rebuilt(root, first, count)
    assert mesh.nodes <= len(tree.nodes)
    words, table = words_of(positions, indices)
    # As in a frame: corners and boxes are refitted first.
    nodes, triangles = buffers.nodes.copy(), buffers.triangles.copy()
    own = triangles[first:]
    for corner, name in enumerate("abc"):
        own[name] = np.nan_to_num(end[own["primitive"], corner])
    own["flags"] = np.where(np.isfinite(end[own["primitive"]]).all(axis=(1, 2)), 0, model.UNUSABLE)
    below = tree.nodes.copy()
    pack.refit(below, tree.levels, own)
    nodes[root : root + len(below)] = pack.moved(below, root, first)
    refitted = replace(buffers, nodes=nodes, triangles=triangles)
    rebuilt, pairs = rebuilder.run(mesh, refitted, mesh.rebuild(), table, words)
    again, _ = rebuilder.run(mesh, refitted, mesh.rebuild(), table, words)
    assert np.array_equal(rebuilt.nodes, again.nodes) and np.array_equal(rebuilt.triangles, again.triangles)
    codes = pairs.reshape(-1, 2)[:, 0]
    assert (np.diff(codes.astype(np.int64)) >= 0).all()
    assert walk(rebuilt.nodes, root, first, count) <= model.DEPTH_LARGEST
    sorted_ = rebuilt.triangles["primitive"][first : first + count]
    assert sorted(sorted_.tolist()) == list(range(count))
    if count == 1000:
        # Cells of the box around all triangles; a centre on the edge of two cells may be in either.
        low, high = end.min(axis=(0, 1)), end.max(axis=(0, 1))
        centres = np.concatenate([end.min(axis=1) / 2 + end.max(axis=1) / 2, [low, high]])
        assert (codes == morton.codes(centres, 10)[:-2][sorted_]).mean() > 0.99
    # What is outside of the mesh has not changed.
    assert np.array_equal(rebuilt.nodes[:root], buffers.nodes[:root])
    assert np.array_equal(rebuilt.triangles[:first], buffers.triangles[:first])
    box = pack.buffers([pack.mesh_tree(positions, indices)], np.eye(4)[None], [0])
    origins, directions = random_rays(2000, 6)
    rays = rays_of(origins, directions)
    # Through the upper level of a scene that was built for the mesh as it is.
    placed = replace(rebuilt, instances=rebuilt.instances.copy())
    placed.nodes[buffers.levels[0] :]["low0"] = -100
    placed.nodes[buffers.levels[0] :]["high0"] = 100
    placed.nodes[buffers.levels[0] :]["low1"] = -100
    placed.nodes[buffers.levels[0] :]["high1"] = 100
    hits, expected = tracer.trace(placed, rays), tracer.trace(box, rays)
    assert np.array_equal(hits.primitive, expected.primitive) and np.array_equal(hits.t, expected.t)
    usable = end[1:] if count == 33 else end
    found, _, sure = nearest(usable, origins, directions)
    assert np.array_equal(hits.hit[sure], found[sure] >= 0)


def test_equal_codes_and_flat_meshes(kernels):
    """All triangles in one cell: the numbers of leaves alone decide, and depth stays bounded."""
    rebuilder = Rebuilder(kernels)
    corners = np.repeat(soup(1, 1), 500, axis=0)
    positions, indices = indexed(corners)
    tree = pack.mesh_tree(positions, indices, deforming=True)
    buffers = pack.buffers([tree], np.eye(4)[None], [0])
    mesh = Rebuilt(0, 0, 500)
    words, table = words_of(positions, indices)
    rebuilt, pairs = rebuilder.run(mesh, buffers, mesh.rebuild(), table, words)
    assert walk(rebuilt.nodes, 0, 0, 500) <= 8
    assert rebuilt.triangles["primitive"].tolist() == tree.triangles["primitive"].tolist()  # a stable sort
    assert len(np.unique(pairs.reshape(-1, 2)[:, 0])) == 1


def test_depth_has_a_bound_for_any_number_of_triangles():
    for count in (1, 4, 5, 1000, 10**5, 10**6, 1 << 27, model.TRIANGLES_LARGEST):
        mesh = Rebuilt(0, 0, count)
        assert mesh.bits + max(count - 1, 0).bit_length() <= model.DEPTH_LARGEST
        assert mesh.bits >= 15 and mesh.width >= count > mesh.width // 2
    assert list(Rebuilt(0, 0, 0).rebuild()) == []
    assert Rebuilt(0, 0, 16_000).bits == 30


def test_a_rebuild_brings_the_cost_down_again(kernels):
    """A mesh whose triangles changed places: refits leave its boxes large, a rebuild is near a tree of the heuristic.

    After it, a small motion is refitted in the new order.
    """
    rebuilder = Rebuilder(kernels)
    start, end = soup(800, 1, 0.03), soup(800, 2, 0.03)
    tree = pack.mesh_tree(*indexed(start), deforming=True)
    buffers = pack.buffers([tree], np.eye(4)[None], [0])
    built = rebuilder.cost(buffers, 0, len(tree.nodes))
    assert built == pytest.approx(build.cost(tree.nodes), rel=1e-5)
    moved = buffers.triangles.copy()
    for corner, name in enumerate("abc"):
        moved[name] = end[moved["primitive"], corner]
    below = tree.nodes.copy()
    pack.refit(below, tree.levels, moved)
    nodes = buffers.nodes.copy()
    nodes[: len(below)] = below
    refitted = replace(buffers, nodes=nodes, triangles=moved)
    worse = rebuilder.cost(refitted, 0, len(tree.nodes))
    assert worse > 4 * built
    positions, indices = indexed(end)
    words, table = words_of(positions, indices)
    mesh = Rebuilt(0, 0, 800)
    rebuilt, pairs = rebuilder.run(mesh, refitted, mesh.rebuild(), table, words)
    cost = rebuilder.cost(rebuilt, 0, mesh.nodes)
    best = build.sah_cost(build.build(end.min(axis=1), end.max(axis=1)))
    assert best * 0.9 < cost < best * 1.6 and cost < worse / 2
    assert cost == pytest.approx(build.cost(rebuilt.nodes[: mesh.nodes]), rel=1e-5)
    nearly = np.float32(end + 0.01 * np.sin(end[:, :, [1, 2, 0]] * 5))
    words, table = words_of(*indexed(nearly))
    fitted, _ = rebuilder.run(mesh, rebuilt, mesh.refit(), table, words, pairs)
    assert np.array_equal(fitted.triangles["primitive"], rebuilt.triangles["primitive"])
    assert np.array_equal(fitted.triangles["a"], nearly[fitted.triangles["primitive"], 0])
    low = np.minimum(fitted.nodes["low0"][0], fitted.nodes["low1"][0])
    assert np.array_equal(low, nearly.min(axis=(0, 1)))
    assert rebuilder.cost(fitted, 0, mesh.nodes) < 1.2 * cost
