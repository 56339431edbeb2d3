"""Meshlets: every triangle once and as it was, within the limits, and about as full as another builder's."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from assets import locate
from chapters.ch06.meshlets import build, model, order
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.groups import batches, previous_use, sorting_order, spans
from chapters.ch06.meshlets.model import takes_meshlets
from chapters.ch06.meshlets.packing import unpack_counts, unpack_words
from common.errors import SceneError
from common.gltf import load_scene
from common.scene import Deformation, Material
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.meshes import grid, scene_of
from tests.support.meshlet_surfaces import (
    SURFACES,
    doubled,
    placed,
    soup,
    sphere,
    theirs_of_scene,
    triangles_of,
)
from tests.support.timing import least_time, timed

generation = pytest.mark.feature("meshlets/generation")
LIMITS = ((64, 124), (32, 64), (128, 128), (256, 256), (3, 1), (255, 7))


def check(scene, meshlets, vertices, triangles):
    """Hold all that meshlets promise against the scene, by sets and counters."""
    covered = np.zeros(len(scene.indices), bool)
    vertex_counts, triangle_counts = unpack_counts(meshlets.records["counts"])
    assert (np.diff(meshlets.records["mesh"].astype(int)) >= 0).all()
    assert meshlets.ranges[:, 1].sum() == len(meshlets.records)
    for mesh, (first, count) in enumerate(meshlets.ranges.tolist()):
        if not count:
            continue
        source = triangles_of(scene, mesh, scene.indices)
        permuted = triangles_of(scene, mesh, meshlets.indices)
        assert Counter(map(tuple, source.tolist())) == Counter(map(tuple, permuted.tolist()))
        row, end = scene.meshes[mesh], 0
        covered[row["first_index"] : row["first_index"] + row["index_count"]] = True
        for number in range(first, first + count):
            record = meshlets.records[number]
            assert (record["mesh"], record["first_index"]) == (mesh, end)
            own = permuted.reshape(-1)[end : end + 3 * triangle_counts[number]]
            assert 0 < triangle_counts[number] <= triangles
            assert vertex_counts[number] == len(set(own.tolist())) <= vertices
            words = meshlets.words[record["data"] :]
            local = words[vertex_counts[number] :].view(np.uint8)[: len(own)]
            assert local.max() < vertex_counts[number]
            assert (words[local] == own).all()
            end += len(own)
        assert end == row["index_count"]
        most = min(min(vertices, 255) // 3, triangles)
        assert count <= len(source) / (0.6 * most) + 1
    assert (meshlets.indices[~covered] == scene.indices[~covered]).all()
    assert (unpack_words(meshlets.records, meshlets.words).reshape(-1, 3) < len(scene.positions)).all()


@generation
@pytest.mark.filterwarnings(
    "ignore:invalid value"
)  # normals of the surface with NaN, which nothing here reads
@pytest.mark.parametrize("limits", LIMITS, ids=str)
@pytest.mark.parametrize("name", SURFACES)
def test_triangles_are_those_of_the_mesh_and_limits_hold(name, limits):
    scene = scene_of(SURFACES[name])
    meshlets = build_meshlets(scene, *limits)
    if limits == (64, 124):
        assert len(meshlets.records) > 1
    check(scene, meshlets, *limits)


@generation
def test_a_check_that_finds_a_lost_triangle():
    scene = scene_of(SURFACES["soup"])
    meshlets = build_meshlets(scene)
    meshlets.indices[:3] = meshlets.indices[3:6]
    with pytest.raises(AssertionError):
        check(scene, meshlets, 64, 124)


@generation
def test_many_meshes_at_once_are_each_as_they_are_alone():
    surfaces = [grid(9, 9), soup(200), grid(1, 1), placed(sphere(12), 5.0, 3.0), doubled(grid(7, 7))]
    scene = scene_of(*surfaces)
    together = build_meshlets(scene)
    check(scene, together, 64, 124)
    for mesh, surface in enumerate(surfaces):
        alone = build_meshlets(scene_of(surface))
        first, count = together.ranges[mesh].tolist()
        own = together.records[first : first + count]
        for field in ("centre", "radius", "extent", "cone", "first_index", "counts"):
            assert own[field].tobytes() == alone.records[field].tobytes(), (mesh, field)
        assert (unpack_words(own, together.words) == unpack_words(alone.records, alone.words)).all()


@generation
def test_batches_change_nothing_that_is_promised(monkeypatch):
    scene = scene_of(sphere(40), grid(9, 9), soup(900), grid(20, 20))
    whole = build_meshlets(scene)
    assert build_meshlets(scene).records.tobytes() == whole.records.tobytes(), "not the same twice"
    monkeypatch.setattr(build, "AT_ONCE", 700)
    parts = build_meshlets(scene)
    check(scene, parts, 64, 124)
    assert abs(len(parts.records) - len(whole.records)) < 0.1 * len(whole.records)
    assert parts.records[parts.ranges[1, 0] :][:3].tobytes() != whole.records[:3].tobytes()


@generation
def test_meshes_that_take_the_classic_path():
    many = grid(9, 9)  # 162 triangles, 100 vertices
    few = many[0], np.tile(many[1][: 3 * 31], 4)  # 124 triangles, but less than 64 of the vertices
    kinds = (Material(), Material(alpha_mode="blend"), Material(alpha_mode="mask"))
    scene = scene_of(
        many, many, many, many, grid(7, 7), grid(3, 20), few, kinds=kinds, materials=(0, 1, 2, 0, 0, 0, 0)
    )
    assert takes_meshlets(scene).tolist() == [True, False, True, True, False, True, False]
    scene.deformations.append(Deformation(3, 0))
    scene.meshes["index_count"][2] = 0
    expected = [True, False, False, False, False, True, False]
    assert takes_meshlets(scene).tolist() == expected
    assert (build_meshlets(scene).ranges[:, 1] > 0).tolist() == expected
    assert takes_meshlets(scene, 256, 256).tolist() == [False] * 7
    assert not len(build_meshlets(scene_of(grid(2, 2))).records)


@generation
def test_scenes_without_triangles_or_meshes():
    scene = scene_of(grid(1, 1), grid(1, 1))
    scene.meshes["index_count"] = 0
    for rows in (scene.meshes, scene.meshes[:0]):
        scene.meshes = rows
        scene.instances.mesh, scene.instances.node = (np.zeros(0, np.int32),) * 2
        meshlets = build_meshlets(scene)
        assert meshlets.ranges.tolist() == [[0, 0]] * len(rows) and not len(meshlets.records)
        assert not len(meshlets.words) and (meshlets.indices == scene.indices).all()


@generation
def test_cloth_takes_the_classic_path():
    scene = cloth_scene_of(cloth(24, 24), size=(24, 24))
    assert scene.meshes["index_count"].tolist() == [3 * 2 * 23 * 23]
    assert takes_meshlets(scene).tolist() == [False]
    scene.nodes.extras.clear()
    assert takes_meshlets(scene).tolist() == [True]


@generation
def test_meshes_that_share_indices():
    surface = sphere(16)
    other = placed(surface, 2.0, 9.0)
    scene = scene_of(surface, other, grid(9, 9), kinds=(Material(), Material(alpha_mode="blend")))
    scene.meshes["first_index"][1] = 0  # the same triangles over other vertices
    meshlets = build_meshlets(scene)
    check(scene, meshlets, 64, 124)
    (a, count), (b, again) = meshlets.ranges[:2].tolist()
    one, two = meshlets.records[a : a + count], meshlets.records[b : b + again]
    assert (one["data"] == two["data"]).all() and (one["first_index"] == two["first_index"]).all()
    assert np.allclose(two["radius"], 2 * one["radius"], rtol=1e-5)
    scene.meshes["material"][1] = 1  # blended: its triangles keep their order, and so do those of the other
    assert takes_meshlets(scene).tolist() == [False, False, True]
    scene.meshes["material"][1] = 0
    scene.meshes["index_count"][1] = 3 * 700  # a part of the other's
    assert takes_meshlets(scene).tolist() == [False, False, True]


@generation
def test_what_cannot_be_built_is_one_sentence(monkeypatch):
    scene = scene_of(grid(9, 9))
    for limits in ((2, 124), (257, 124), (64, 0), (64, 257)):
        with pytest.raises(ValueError, match="3 to 256 vertices and 1 to 256 triangles"):
            build_meshlets(scene, *limits)
    monkeypatch.setattr(build, "MOST_INDICES", 485)
    with pytest.raises(SceneError, match="have 486 indices, and meshlets are built for at most 485"):
        build_meshlets(scene)


@generation
@pytest.mark.long
def test_a_mesh_of_16_million_triangles(monkeypatch):
    monkeypatch.setattr(model, "PAGE_BYTES", 1 << 30)  # the builder alone: a page of geometry has 128 MiB
    positions, indices = grid(2048, 4096)
    scene = scene_of((positions, indices))
    assert len(indices) == 3 * 2**24
    meshlets = build_meshlets(scene)
    first = meshlets.records["first_index"].astype(np.int64)
    _, triangles = unpack_counts(meshlets.records["counts"])
    assert (first == 3 * (np.cumsum(triangles) - triangles)).all() and triangles.sum() == 2**24
    assert (unpack_words(meshlets.records, meshlets.words) == meshlets.indices).all()
    keys = [(part.reshape(-1, 3) @ np.array([1, 7919, 104729])) for part in (indices, meshlets.indices)]
    assert (np.sort(keys[0]) == np.sort(keys[1])).all()


# --- against another builder ---


def compare(name, scene):
    """Return our fill and theirs, in triangles a meshlet, and their bound of the count with ours."""
    meshlets = build_meshlets(scene)
    _, ours = unpack_counts(meshlets.records["counts"])
    others = list(theirs_of_scene(scene, np.flatnonzero(meshlets.ranges[:, 1])))
    fill = np.concatenate([each.triangles for each in others]).mean()
    print(f"{name}: {len(ours)} meshlets of {ours.mean():.1f} triangles, meshoptimizer {fill:.1f}")
    assert len(ours) <= sum(each.bound for each in others)
    return ours.mean(), fill


@generation
@pytest.mark.needs("meshoptimizer")
@pytest.mark.parametrize("name", ["grid", "sphere", "turned", "soup", "unshared", "atrium", "spheres"])
def test_fill_is_near_that_of_meshoptimizer(name):
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    surfaces = {**SURFACES, "grid": grid(120, 90), "sphere": sphere(60)}
    surfaces["turned"] = (surfaces["grid"][0] @ turn).astype(np.float32), surfaces["grid"][1]
    ours, fill = compare(
        name, load_scene(locate(name)) if name in ("atrium", "spheres") else scene_of(surfaces[name])
    )
    assert ours >= 0.8 * fill


@generation
@pytest.mark.needs("meshoptimizer")
@pytest.mark.parametrize(
    "name", ["ToyCar", "FlightHelmet", "Suzanne", "LightsPunctualLamp", "NormalTangentTest", "SpecularTest"]
)
def test_fill_of_models_is_near_that_of_meshoptimizer(models, name):
    path = next(path for path in sorted((models / name).rglob("*")) if path.suffix in (".gltf", ".glb"))
    ours, fill = compare(name, load_scene(path, decode=False))
    assert ours >= 0.8 * fill


@generation
@pytest.mark.alone
def test_a_hundred_thousand_triangles_take_half_a_second():
    city = grid(5, 10)
    for name, scene in (
        ("one sphere", scene_of(sphere(158))),
        ("a thousand meshes", scene_of(*[city] * 1000)),
    ):
        count = len(scene.indices) // 3
        took = least_time(timed(lambda scene=scene: build_meshlets(scene)), 0.5 * count / 1e5, fewest=2)
        print(f"{name}: {count} triangles in {took:.3f} s of one core")
        assert took < 0.5 * count / 1e5


# --- the steps ---


def test_the_sort_is_that_of_numpy():
    rng = np.random.default_rng(7)
    for most in (1, 200, 70000, 2**33):
        keys = [rng.integers(0, most, 500), rng.integers(0, 9, 500), rng.integers(0, most, 500)]
        assert (sorting_order(*keys) == np.lexsort(keys)).all()
    assert sorting_order(np.zeros(4, np.int64)).tolist() == [0, 1, 2, 3]


def test_ranges_and_batches():
    assert spans(np.array([5, 2, 9]), np.array([2, 0, 3])).tolist() == [5, 6, 9, 10, 11]
    sizes = np.array([3, 4, 9, 1, 1, 1])
    parts = [sizes[part].tolist() for part in batches(sizes, 5)]
    assert parts == [[3, 4], [9], [1, 1, 1]]
    assert [sizes[part].tolist() for part in batches(sizes, 100)] == [sizes.tolist()]


def test_the_previous_use_of_a_vertex():
    assert previous_use(np.array([4, 4, 0, 4, 0, 7])).tolist() == [-1, 0, -1, 1, 2, -1]


def test_islands_are_those_of_a_search():
    rng = np.random.default_rng(11)
    for vertices in (60, 200, 2000):
        triangles = rng.integers(0, vertices, (300, 3)).astype(np.uint32)
        begins = np.repeat([0, 120], [120, 180])
        expected = np.full(300, -1)
        for seed in range(300):
            stack = [seed] if expected[seed] < 0 else []
            while stack:
                now = stack.pop()
                if expected[now] >= 0:
                    continue
                expected[now] = seed
                near = (triangles[:, :, None] == triangles[now]).any(axis=(1, 2)) & (begins == begins[now])
                stack += np.flatnonzero(near & (expected < 0)).tolist()
        assert (order.islands(triangles.reshape(-1), begins) == expected).all()


def test_the_two_sides_of_a_wall_are_in_different_meshlets():
    front = grid(24, 24, height=0.0)
    back = front[0] - np.float32((0, 0, 1e-3)), front[1].reshape(-1, 3)[:, ::-1].reshape(-1)
    wall = np.concatenate([front[0], back[0]]), np.concatenate([front[1], back[1] + len(front[0])])
    scene = scene_of(wall)
    meshlets = build_meshlets(scene)
    _, triangles = unpack_counts(meshlets.records["counts"])
    sides = triangles_of(scene, 0, meshlets.indices)[:, 0] >= len(front[0])
    mixed = [len({*part.tolist()}) > 1 for part in np.split(sides, np.cumsum(triangles)[:-1])]
    assert sum(mixed) <= 1 < len(mixed)


def test_meshlets_of_permuted_indices_have_the_same_triangles():
    scene = scene_of(sphere(20))
    meshlets = build_meshlets(scene)
    view = replace(scene, indices=meshlets.indices)
    again = build_meshlets(view)
    assert Counter(map(tuple, again.indices.reshape(-1, 3).tolist())) == Counter(
        map(tuple, scene.indices.reshape(-1, 3).tolist())
    )
