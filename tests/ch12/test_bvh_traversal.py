"""What rays hit through the hierarchy, on both backends: as by brute force in float64; closed meshes do not leak."""

from __future__ import annotations

import numpy as np
import pytest

from assets import locate
from chapters import ch12
from chapters.ch12.rays.bvh import model, pack
from common.gltf import load_scene
from common.scene.pose import evaluate_pose
from tests.support.hierarchies import Tracer, icosphere, indexed, random_rays, rays_of, soup, torus
from tests.support.kernels import kernels_on
from tests.twins.brute_rays import nearest as every_triangle
from tests.twins.rays import box_interval, moeller_trumbore, nearest

pytestmark = [pytest.mark.variants("vulkan", "gl"), pytest.mark.feature("ray-tracing/software-bvh")]
ALONE = np.eye(4)[None]
BOTH = (("NON_OPAQUE", 1), ("STEPS", 1))
"""Defines of the traversal; compiling it takes longer than its rays."""


@pytest.fixture(scope="module")
def tracer(chapter, tmp_path_factory):
    with kernels_on(chapter.device, ch12.__name__) as kernels:
        yield Tracer(kernels, model, tmp_path_factory.mktemp("rays"))


def alone(positions, triangles):
    """Return the buffers of one mesh at rest."""
    return pack.buffers([pack.mesh_tree(positions, np.uint32(triangles).reshape(-1))], ALONE, [0])


def same_places(t, truth, rays, size=2.0):
    """Return whether hits are where they should be: t within 1e-5, and beside the origin within 16 u of the size.

    Corners are rounded relative to the origin of the ray, so that what is nearer than triangles are long has the errors
    of their length.
    """
    length = np.linalg.norm(rays[:, 4:7].astype(np.float64), axis=1)
    return np.abs(t - truth) * length <= 1e-5 * truth * length + 2.0**-20 * size


def check(hits, corners, rays, which=None, least=0.2):
    """Hold hits to every triangle (T, 3, 3) in float64, where no edge is near; `which` names the triangles."""
    origins, directions = rays[:, :3], rays[:, 4:7]
    found, t, sure = nearest(corners, origins, directions)
    assert sure.mean() > 0.9
    names = np.arange(len(corners)) if which is None else which
    expected = np.where(found >= 0, names[found], -1)
    assert np.array_equal(hits[0][sure], expected[sure])
    both = sure & (found >= 0)
    assert both.mean() > least
    assert same_places(hits[1], t, rays)[both].all()
    assert (np.abs(hits[1] - t) <= 1e-5 * t)[both].mean() > 0.99
    return both


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 40, 700])
def test_a_soup_is_hit_as_by_brute_force(tracer, count):
    corners = soup(count, count, 0.15 if count > 40 else 0.8)
    origins, directions = random_rays(2500, 2)
    rays = rays_of(origins, directions)
    buffers = alone(*indexed(corners))
    hits = tracer.trace(buffers, rays)
    both = check((hits.primitive, hits.t), corners, rays, least=0.0)
    exact = corners.astype(np.float64)[hits.primitive[both]]
    at = hits.at[both].astype(np.float64)
    place = exact[:, 0] + at[:, :1] * (exact[:, 1] - exact[:, 0]) + at[:, 1:] * (exact[:, 2] - exact[:, 0])
    aim = origins[both] + directions[both].astype(np.float64) * hits.t[both][:, None]
    assert np.abs(place - aim).max() < 2e-5
    normal = np.cross(exact[:, 1] - exact[:, 0], exact[:, 2] - exact[:, 0])
    assert np.array_equal(hits.back[both], (normal * directions[both]).sum(axis=1) > 0)
    assert (hits.instance[both] == 0).all() and (hits.t[~hits.hit] == np.float32(1e30)).all()
    assert np.array_equal(tracer.occluded(buffers, rays), hits.hit)


@pytest.mark.parametrize("name", ["atrium", "market"])
def test_real_scenes_are_hit_as_by_brute_force(tracer, name):
    """All meshes and instances of a scene: instance, triangle and distance of rays between random places."""
    scene = load_scene(locate(name))
    meshes, mesh_of = scene.meshes, scene.instances.mesh
    matrices = np.float64(np.float32(evaluate_pose(scene, 0.0).world_from_object))
    lists = [
        scene.indices[m["first_index"] : m["first_index"] + m["index_count"]].reshape(-1, 3) for m in meshes
    ]
    vertices = [scene.positions[m["first_vertex"] : m["first_vertex"] + m["vertex_count"]] for m in meshes]
    trees = [
        pack.mesh_tree(positions, list_.reshape(-1)) for positions, list_ in zip(vertices, lists, strict=True)
    ]
    buffers = pack.buffers(trees, matrices, mesh_of)
    boxes = pack.world_boxes(matrices, np.array([tree.box for tree in trees])[mesh_of]).astype(np.float64)
    rng = np.random.default_rng(4)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    origins = np.float32(rng.uniform(low, high, (40, 3)))
    rays = rays_of(origins, np.float32(rng.uniform(low, high, (40, 3)) - origins))
    hits = tracer.trace(buffers, rays)
    compared = 0
    for ray, (instance, primitive, t) in zip(
        rays, zip(hits.instance, hits.primitive, hits.t, strict=True), strict=True
    ):
        enter, leave = box_interval(boxes[:, 0] - 1e-3, boxes[:, 1] + 1e-3, ray[:3], ray[4:7])
        near = np.flatnonzero((enter <= leave) & (leave > 0))
        corners = [
            vertices[m][lists[m]].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
            for m, matrix in zip(mesh_of[near], matrices[near], strict=True)
        ]
        owner = np.repeat(near, [len(part) for part in corners])
        number = np.concatenate([np.arange(len(part)) for part in corners])
        found, truth, sure = nearest(np.concatenate(corners), ray[None, :3], ray[None, 4:7], doubt=1e-4)
        if sure[0]:  # not within another wall, and not on an edge
            compared += 1
            assert (instance, primitive) == (
                (owner[found[0]], number[found[0]]) if found[0] >= 0 else (-1, -1)
            )
            assert found[0] < 0 or same_places(t, truth, ray[None], np.abs(high - low).max()).all()
    assert compared > 20


CLOSED = {"icosphere-0": icosphere(0), "icosphere-3": icosphere(3), "torus": torus(60, 24)}


@pytest.mark.parametrize("place", ["corners", "edges"])
@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_have_no_leaks(tracer, name, place):
    """Rays from inside, aimed at corners and at points of edges, each hit something; so do those through instances."""
    positions, triangles = CLOSED[name]
    rng = np.random.default_rng(6)
    count = 6000
    edges = triangles[rng.integers(len(triangles), size=count)][:, :2]
    part = rng.random((count, 1)) if place == "edges" else np.zeros((count, 1))
    aim = positions[edges[:, 0]] * (1 - part) + positions[edges[:, 1]] * part
    if name == "torus":
        turn = rng.uniform(0, 2 * np.pi, count)
        inside = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1) + rng.uniform(-0.1, 0.1, (count, 3))
    else:
        inside = rng.uniform(-0.3, 0.3, (count, 3))
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [3.0, 0.2, -1.0]
    for matrix, offset in ((np.eye(3), 0.0), (turned, 50.0)):
        placed = np.eye(4)
        placed[:3, :3], placed[:3, 3] = matrix, offset
        buffers = pack.buffers(
            [pack.mesh_tree(positions, np.uint32(triangles).reshape(-1))], placed[None], [0]
        )
        origins = np.float32(inside @ matrix.T + offset)
        rays = rays_of(origins, np.float32(aim @ matrix.T + offset - origins))
        assert tracer.trace(buffers, rays).hit.all()
        assert tracer.occluded(buffers, rays).all()
        # A triangle that is missing is noticed.
        holed = pack.buffers(
            [pack.mesh_tree(positions, np.uint32(triangles[7:]).reshape(-1))], placed[None], [0]
        )
        assert not tracer.trace(holed, rays).hit.all() or len(triangles) > 1000


def instances(count, seed, spread=3.0):
    """Return matrices with rotation, uneven scale and, for half of them, a mirror."""
    rng = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    turns[::2, :, 0] *= -1
    matrices[:, :3, :3] = turns * rng.uniform(0.3, 1.5, (count, 1, 3))
    matrices[:, :3, 3] = rng.uniform(-spread, spread, (count, 3))
    return np.float64(np.float32(matrices))


def test_instances_turned_scaled_and_mirrored(tracer):
    meshes = [soup(60, 1, 0.4), soup(5, 2, 0.8)]
    matrices = instances(30, 3)
    assert (np.linalg.det(matrices[:, :3, :3]) < 0).any() and (np.linalg.det(matrices[:, :3, :3]) > 0).any()
    mesh_of = np.arange(30) % 2
    buffers = pack.buffers([pack.mesh_tree(*indexed(mesh)) for mesh in meshes], matrices, mesh_of)
    corners = [
        meshes[m].astype(np.float64) @ w[:3, :3].T + w[:3, 3] for w, m in zip(matrices, mesh_of, strict=True)
    ]
    owner = np.repeat(np.arange(30), [len(part) for part in corners])
    number = np.concatenate([np.arange(len(part)) for part in corners])
    rays = rays_of(*random_rays(1500, 5, 4.0))
    hits = tracer.trace(buffers, rays)
    names = np.where(hits.hit, hits.instance * 1000 + hits.primitive, -1)
    both = check((names, hits.t), np.concatenate(corners), rays, owner * 1000 + number)
    # The side that is seen is that in object space: a mirror does not turn it.
    objects = np.array(
        [np.linalg.inv(matrices[i])[:3, :3] @ d for i, d in zip(hits.instance, rays[:, 4:7], strict=True)]
    )
    own = np.array(
        [meshes[m][p] for m, p in zip(mesh_of[hits.instance], hits.primitive, strict=True)], object
    )
    own = np.stack(list(own)).astype(np.float64)
    normal = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    assert np.array_equal(hits.back[both], ((normal * objects).sum(axis=1) > 0)[both])


def test_masks_choose_instances(tracer):
    """Three sheets behind one another, each with a mask of its own, and one whose mask is 0."""
    sheet = np.float32([[(-1, -1, 0), (1, -1, 0), (0, 2, 0)]])
    matrices = np.tile(np.eye(4), (4, 1, 1))
    matrices[:, 2, 3] = [4, 3, 2, 1]
    buffers = pack.buffers([pack.mesh_tree(*indexed(sheet))], matrices, [0] * 4, mask=[0, 1, 2, 128])
    rays = rays_of([(0, 0, 9)] * 2, [(0, 0, -1), (0, 0, -2)])
    for mask, expected in ((0xFF, 1), (1, 1), (2, 2), (3, 1), (128, 3), (130, 2), (4, -1), (0, -1)):
        assert tracer.trace(buffers, rays, mask).instance.tolist() == [expected] * 2
        assert tracer.occluded(buffers, rays, mask).tolist() == [expected >= 0] * 2


def test_surfaces_that_are_not_opaque_ask_for_each_candidate(tracer):
    """Two instances of a soup, one flagged: the first hit among those that the function accepts, of the other all."""
    corners = soup(120, 21, 0.3)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 0.7
    buffers = pack.buffers([pack.mesh_tree(*indexed(corners))], matrices, [0, 0], flags=[0, model.NON_OPAQUE])
    placed = np.concatenate([corners, corners.astype(np.float64) + matrices[1, :3, 3]])
    rays = rays_of(*random_rays(1500, 22))
    t, u, _, inside = moeller_trumbore(placed, rays[:, None, :3], rays[:, None, 4:7])
    accepted = np.arange(240) < 120
    accepted = accepted | ((np.arange(240) % 120 % 2 == 1) & (u < 0.5))
    sure = ((np.abs(inside) > 1e-5) & (np.abs(u - 0.5) > 1e-5)).all(axis=1)
    reached = np.where(accepted & (inside >= 0) & (t > 0), t, np.inf)
    which = np.where(np.isfinite(reached.min(axis=1)), reached.argmin(axis=1), -1)
    hits = tracer.trace(buffers, rays, 0xFF, *BOTH)
    assert sure.mean() > 0.9
    assert np.array_equal(np.where(hits.hit, hits.instance * 120 + hits.primitive, -1)[sure], which[sure])
    assert np.array_equal(tracer.occluded(buffers, rays, 0xFF, *BOTH)[sure], which[sure] >= 0)
    opaque = tracer.trace(buffers, rays)
    assert not np.array_equal(opaque.primitive, hits.primitive)


def test_a_side_is_skipped_of_surfaces_with_one_side(tracer):
    """Of three instances, one mirrored, the last has two sides. Sides are those of object space."""
    corners = soup(120, 31, 0.3)
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[1] = np.diag((-1.0, 1.0, 1.0, 1.0))
    matrices[1:, :3, 3] = (0.5, 0.3, 0.0), (0.0, -0.6, 0.3)
    flags = [0, model.NON_OPAQUE, model.TWO_SIDED]
    buffers = pack.buffers([pack.mesh_tree(*indexed(corners))], matrices, [0] * 3, flags=flags)
    placed = [corners.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3] for matrix in matrices]
    ids = np.array([(i, k, i == 1) for i in range(3) for k in range(120)])
    rays = rays_of(*random_rays(1500, 32))
    seen = {}
    for sides, side in ((0, ""), (16, "backs"), (32, "fronts")):
        tracer.sides = sides
        try:
            hits, blocked = tracer.trace(buffers, rays), tracer.occluded(buffers, rays)
        finally:
            tracer.sides = 0
        left = {side: ids[:, 0] == 2} if side else {}
        truth = every_triangle(rays[:, :3], rays[:, 4:7], 0.0, 1e30, np.concatenate(placed), ids, **left)
        sure = truth.margin > 1e-4
        assert sure.mean() > 0.5 and set(truth.instance[sure].tolist()) == {-1, 0, 1, 2}
        for found, wanted in ((hits.instance, truth.instance), (hits.primitive, truth.primitive)):
            assert np.array_equal(found[sure], wanted[sure])
        assert np.array_equal(hits.back[sure], truth.back[sure])
        assert np.array_equal(blocked[sure], (truth.instance >= 0)[sure])
        seen[sides] = hits.instance
    assert (seen[0] != seen[16]).sum() > 50 and (seen[16] != seen[32]).sum() > 50


def test_ends_of_rays_do_not_belong_to_them(tracer):
    sheet = np.float32([[(-1, -1, 0), (1, -1, 0), (0, 2, 0)]])
    buffers = alone(*indexed(sheet))
    for t_min, t_max, hit in (
        (0, 4, False),
        (0, 4.001, True),
        (4, 9, False),
        (3.999, 9, True),
        (5, 9, False),
        (0, 3, False),
    ):
        rays = rays_of([(0, 0, 4)], [(0, 0, -1)], t_min, t_max)
        assert tracer.trace(buffers, rays).hit.tolist() == [hit]
        assert tracer.occluded(buffers, rays).tolist() == [hit]


def test_scenes_of_nothing(tracer):
    rays = rays_of(*random_rays(64, 1))
    nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)
    point = np.float32([[(0, 0, 0)] * 3])
    for meshes, count in (([], 0), ([pack.mesh_tree(*nothing)], 1), ([pack.mesh_tree(*indexed(point))], 2)):
        buffers = pack.buffers(meshes, np.tile(np.eye(4), (count, 1, 1)), [0] * count)
        hits = tracer.trace(buffers, rays)
        assert not hits.hit.any() and (hits.t == np.float32(1e30)).all()
        assert not tracer.occluded(buffers, rays).any()
    full = pack.mesh_tree(*indexed(soup(50, 1, 0.5)))
    flat = np.tile(np.eye(4), (3, 1, 1))
    flat[0, 2, 2], flat[1, 0, 3] = 0.0, np.nan
    hits = tracer.trace(pack.buffers([full, pack.mesh_tree(*nothing)], flat, [0, 0, 1]), rays)
    assert not hits.hit.any()
    flat[0, 2, 2] = 1.0
    assert tracer.trace(pack.buffers([full, pack.mesh_tree(*nothing)], flat, [0, 0, 1]), rays).hit.any()


def test_rays_that_are_no_rays_hit_nothing(tracer):
    rays = rays_of(np.zeros((8, 3)), [(0, 0, 1)] * 8)
    rays[0, 4:7] = 0.0
    rays[1, 0], rays[2, 5], rays[3, 6] = np.nan, np.nan, np.inf
    rays[4, 7], rays[5, 3], rays[6, 2] = np.nan, np.nan, np.inf
    for buffers in (alone(*icosphere(2)), alone(*indexed(soup(1, 1)))):
        hits = tracer.trace(buffers, rays)
        assert not hits.hit[:7].any()
    assert tracer.trace(alone(*icosphere(2)), rays).hit[7]


def test_triangles_without_area_and_without_numbers_are_left_out(tracer):
    corners = soup(200, 8, 0.4)
    corners[10, 1] = np.nan
    corners[20, 2, 1] = np.inf
    corners[30, 1] = corners[30, 0]
    corners[40] = [(0, 0, 0), (1, 2, 3), (0.5, 1, 1.5)]
    corners[50, 0, 0] = 1e30
    tree = pack.mesh_tree(*indexed(corners))
    assert tree.left_out == 5 and len(tree.triangles) == 195
    odd = [10, 20, 30, 40, 50]
    rays = rays_of(*random_rays(2000, 9))
    for deforming in (False, True):
        tree = pack.mesh_tree(*indexed(corners), deforming=deforming)
        hits = tracer.trace(pack.buffers([tree], ALONE, [0]), rays)
        assert not np.isin(hits.primitive, odd).any() and np.isfinite(hits.t).all()
        kept = np.delete(np.arange(200), odd)
        check((hits.primitive, hits.t), corners[kept], rays, kept)


@pytest.mark.parametrize(("scale", "away"), [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e5), (1e3, 1e5)])
def test_a_world_scaled_and_moved_is_hit_alike(tracer, scale, away):
    """Instances are placed: their meshes keep small numbers, so that a place 1e5 m away costs what its floats cost."""
    mesh = soup(80, 12, 0.4)
    matrices = instances(12, 13)
    matrices[:, :3] *= scale
    matrices[:, :3, 3] += away * np.array([1.0, -0.5, 0.25])
    matrices = np.float64(np.float32(matrices))
    buffers = pack.buffers([pack.mesh_tree(*indexed(mesh))], matrices, [0] * 12)
    corners = np.concatenate([mesh.astype(np.float64) @ w[:3, :3].T + w[:3, 3] for w in matrices])
    origins, directions = random_rays(1500, 14, 4.0)
    rays = rays_of(origins * scale + away * np.array([1.0, -0.5, 0.25]), directions * scale)
    hits = tracer.trace(buffers, rays)
    found, t, sure = nearest(corners, rays[:, :3], rays[:, 4:7], doubt=1e-5)
    assert np.array_equal((hits.instance * 80 + hits.primitive)[sure & hits.hit], found[sure & hits.hit])
    assert np.array_equal(hits.hit[sure], (found >= 0)[sure])
    both = sure & (found >= 0)
    assert both.mean() > 0.2 and same_places(hits.t, t, rays, 4.0 * scale)[both].all()
    assert (np.abs(hits.t - t) <= 1e-5 * t)[both].mean() > 0.99


def test_steps_are_counted_and_fewer_than_all(tracer):
    buffers = alone(*icosphere(3))
    rays = rays_of(*random_rays(500, 15))
    hits = tracer.trace(buffers, rays, 0xFF, *BOTH)
    plain = tracer.trace(buffers, rays)
    assert np.array_equal(hits.primitive, plain.primitive) and np.array_equal(hits.t, plain.t)
    assert (plain.steps == 0).all() and (hits.steps >= 1).all() and hits.steps[hits.hit].min() > 5
    assert hits.steps.max() < len(buffers.nodes) / 4


@pytest.mark.long
@pytest.mark.needs("embreex")
def test_a_million_rays_hit_what_embree_says(tracer):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    positions, triangles = icosphere(6)
    rng = np.random.default_rng(16)
    positions = np.float32(positions * (1 + 0.02 * rng.normal(size=(len(positions), 1))))
    embree = rtcore_scene.EmbreeScene()
    TriangleMesh(embree, positions, triangles.astype(np.int32))
    buffers = alone(positions, triangles)
    origins, directions = random_rays(1_000_000, 17)
    theirs = embree.run(origins, directions, output=True)
    hits = tracer.trace(buffers, rays_of(origins, directions))
    differ = np.flatnonzero(hits.primitive != theirs["primID"])
    near = nearest(positions[triangles][np.unique([*hits.primitive[differ], *theirs["primID"][differ]])],
                   origins[differ], directions[differ], doubt=1e-4)  # fmt: skip
    assert len(differ) < 200 and not near[2].any()
    same = (hits.primitive == theirs["primID"]) & hits.hit
    assert same.mean() > 0.3
    assert (np.abs(hits.t[same] - theirs["tfar"][same]) <= 1e-5 * hits.t[same]).mean() > 0.9999
