"""Pages of geometry: no mesh crosses one, what lies where, and a picture that does not tell how many there are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch02.scene import geometry, pages
from chapters.ch02.scene.pages import MESH, deformed, mesh_records, page_arrays, plan_pages
from chapters.ch02.settings import Settings
from common.errors import SceneError
from common.scene import MESH_DTYPE, Deformation, Image, Instances, Light, Material, Pose, Scene
from common.scene.pose import evaluate_pose
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated

ALL = list(geometry.STREAMS)
SIZE = (32, 32)
EXACT = Settings(color_format="rgba32f", background=0.0, tone_curve="none")


def random_scene(seed: int, count: int = 12, instances: int = 0) -> Scene:
    """Return meshes of random triangles, in random order of their vertices; every fourth shares those of another."""
    rng = np.random.default_rng(seed)
    meshes = np.zeros(count, MESH_DTYPE)
    vertices = indices = 0
    order = rng.permutation(count)
    made = []
    for place, mesh in enumerate(order):
        row = meshes[mesh]
        if place % 4 == 3:
            first, corners = (
                int(meshes[order[place - 1]]["first_vertex"]),
                int(meshes[order[place - 1]]["vertex_count"]),
            )
        else:
            first, corners = vertices, int(rng.integers(3, 60))
            vertices += corners
        triangles = rng.integers(0, corners, 3 * int(rng.integers(1, 20))).astype(np.uint32)
        row["first_vertex"], row["vertex_count"] = first, corners
        row["first_index"], row["index_count"] = indices, len(triangles)
        row["bounds_min"], row["bounds_max"] = (-1, -1, 0), (1, 1, 0)
        made.append(triangles)
        indices += len(triangles)
    flat = rng.uniform(-1, 1, (vertices, 3))
    normals = rng.normal(size=(vertices, 3))
    scene = quad_scene(Material(metallic=0.0, roughness=0.6))
    return replace(
        scene,
        positions=flat.astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        tangents=rng.normal(size=(vertices, 4)).astype(np.float32),
        uv0=rng.random((vertices, 2), np.float32),
        uv1=rng.random((vertices, 2), np.float32),
        colors=rng.random((vertices, 4), np.float32),
        indices=np.concatenate(made),
        meshes=meshes,
        mesh_names=[f"mesh {i}" for i in range(count)],
        nodes=nodes_at(*[translated(z=0.01 * i) for i in range(max(1, instances))]),
        instances=Instances(
            np.arange(instances, dtype=np.int32), (np.arange(instances) % count).astype(np.int32)
        ),
    )


def largest(scene: Scene, streams: list[str]) -> int:
    """Return the bytes of the smallest page that holds each mesh by itself."""
    sizes = []
    for row in scene.meshes:
        parts = {name: 4 * geometry.STREAMS[name][1] * int(row["vertex_count"]) for name in streams}
        sizes.append(geometry.stream_offsets({**parts, "indices": 4 * int(row["index_count"])})[1])
    return max(sizes)


def words_of(scene: Scene, page: pages.Page) -> np.ndarray:
    """Return the words of a page's buffer, those that nothing fills 0xFFFFFFFF."""
    raw = np.full(-(-page.size // 4) * 4, 255, np.uint8)
    for offset, array in page_arrays(scene, page):
        part = np.ascontiguousarray(array).view(np.uint8).reshape(-1)
        assert (raw[offset : offset + part.size] == 255).all(), "two streams at one place"
        raw[offset : offset + part.size] = part
    return raw.view(np.uint32)


@pytest.mark.parametrize("streams", [["positions"], ["positions", "uv0"], ALL], ids="-".join)
@pytest.mark.parametrize("seed", range(6))
def test_a_shader_finds_every_vertex_of_every_mesh_in_its_page(seed, streams):
    """Fetched word by word, as vertices.glsl does it, from buffers of every size that holds the largest mesh."""
    scene = random_scene(seed)
    smallest = largest(scene, streams)
    counts = []
    for room in (smallest, 2 * smallest, 5 * smallest, 1 << 20):
        planned = plan_pages(scene, streams, room)
        counts.append(len(planned))
        assert sorted(mesh for page in planned for mesh in page.meshes.tolist()) == list(
            range(len(scene.meshes))
        )
        assert all(page.size <= room for page in planned)
        records, page_of, first_index = mesh_records(scene, planned)
        assert records.dtype == MESH
        held = [words_of(scene, page) for page in planned]
        for number, row in enumerate(scene.meshes):
            assert number in planned[page_of[number]].meshes
            words = held[page_of[number]]
            first, count = int(row["first_vertex"]), int(row["vertex_count"])
            for place, (name, (_, floats)) in enumerate(geometry.STREAMS.items()):
                if name in streams:
                    at = int(records["streams"][number, place])
                    found = words[at : at + floats * count].view(np.float32).reshape(count, floats)
                    assert np.array_equal(found, getattr(scene, name)[first : first + count])
            start, used = int(first_index[number]), int(row["index_count"])
            expected = scene.indices[row["first_index"] : row["first_index"] + used]
            assert np.array_equal(words[start : start + used], expected)
    assert counts == sorted(counts, reverse=True) and counts[0] > 2 and counts[-1] == 1


def test_meshes_that_share_vertices_share_them_in_a_page():
    """And a page is no longer than the part of the pools that it holds, with what aligns its streams."""
    scene = random_scene(1)
    (page,) = plan_pages(scene, ALL, 1 << 20)
    bytes_of_vertex = 4 * sum(floats for _, floats in geometry.STREAMS.values())
    exact = len(scene.positions) * bytes_of_vertex + scene.indices.nbytes
    assert exact <= page.size < exact + geometry.ALIGNMENT * (len(ALL) + 1)
    counted = int(scene.meshes["vertex_count"].astype(np.int64).sum())
    assert counted > len(scene.positions), "some vertices belong to two meshes"


def test_a_page_is_filled_before_the_next_is_begun():
    """Ten equal meshes in pages for three are 3, 3, 3 and 1, whichever order the scene lists them in."""
    scene = quad_scene(materials=(Material(),) * 10)
    for name in ("positions", "normals", "tangents", "uv0"):
        setattr(scene, name, np.tile(getattr(scene, name), (10 * 16, 1)))
    scene.indices = np.tile(scene.indices, 10)
    order = np.random.default_rng(2).permutation(10)
    scene.meshes["first_vertex"], scene.meshes["vertex_count"] = 64 * order, 64
    scene.meshes["first_index"] = 6 * order
    one = largest(scene, ["positions"])
    (whole,) = plan_pages(replace(scene, meshes=scene.meshes[order.argsort()][:3]), ["positions"], 1 << 20)
    planned = plan_pages(scene, ["positions"], whole.size)
    assert [len(page.meshes) for page in planned] == [3, 3, 3, 1]
    assert whole.size < 3 * one + 1, "three in one page need no more than three pages"


def test_no_meshes_are_no_pages():
    scene = quad_scene()
    scene.meshes = scene.meshes[:0]
    assert plan_pages(scene, ALL) == []
    records, page_of, first_index = mesh_records(scene, [])
    assert len(records) == len(page_of) == len(first_index) == 0


def test_a_mesh_larger_than_a_page_is_refused_in_a_sentence():
    scene = random_scene(3)
    room = largest(scene, ALL) - 1
    with pytest.raises(SceneError) as error:
        plan_pages(scene, ALL, room)
    said = str(error.value)
    number = int(re.match(r"Mesh (\d+) takes ", said)[1])
    alone = replace(scene, meshes=scene.meshes[[number]])
    assert largest(alone, ALL) > room, "that one"
    assert said.endswith(".") and "\n" not in said and "split it" in said
    # The figures of the sentence do not contradict each other.
    takes, holds = (
        float(found) for found in re.findall(r"([\d.]+) MiB|holds ([\d.]+)", said) for found in found if found
    )
    assert takes > holds


def test_deformed_vertices_go_to_the_place_of_their_mesh():
    scene = random_scene(4)
    streams = ["positions", "normals", "tangents", "uv0"]
    planned = plan_pages(scene, streams, 2 * largest(scene, streams))
    records, page_of, _ = mesh_records(scene, planned)
    assert len(planned) > 2
    rng = np.random.default_rng(4)
    posed = {
        mesh: tuple(
            rng.normal(size=(int(scene.meshes["vertex_count"][mesh]), width)).astype(np.float32)
            for width in (3, 3, 4)
        )
        for mesh in np.unique(scene.meshes["first_vertex"], return_index=True)[1][::3].tolist()
    }
    pose = replace(evaluate_pose(scene, 0.0), vertices=posed)
    found = {(page, at): raw for page, at, raw in deformed(scene, pose, planned)}
    expected = {
        (int(page_of[mesh]), 4 * int(records["streams"][mesh, place])): array
        for mesh, arrays in posed.items()
        for place, array in enumerate(arrays)
    }
    assert found.keys() == expected.keys() and len({page for page, _ in expected}) > 1
    assert all(np.array_equal(found[key].view(np.float32), expected[key].reshape(-1)) for key in expected)


# --- pictures ---


def fresh(chapter, scene, outputs=("color_linear", "depth", "instance_id")):
    """Return the outputs of the second frame of a renderer, the number of its pages, and its work."""
    with chapter.open(scene, SIZE, EXACT, outputs=outputs) as made:
        for _ in range(2):
            frame = made.render(facing())
        return [frame.image(name) for name in outputs], len(made._data.pages), frame.work


def drawn_scene() -> Scene:
    """Return twelve meshes of three materials: opaque, masked with a texture, blended."""
    scene = random_scene(7, instances=12)
    grey = Image("noise", np.random.default_rng(7).integers(0, 256, (8, 8, 4), dtype=np.uint8))
    matte = Material(metallic=0.0, roughness=0.6, double_sided=True)
    scene.materials[:] = [
        matte,
        Material(unlit=True, alpha_mode="mask", base_color_texture=texture(uv_set=1), alpha_cutoff=0.4),
        Material(unlit=True, alpha_mode="blend", base_color=(0.2, 0.8, 0.4, 0.5)),
    ]
    scene.meshes["material"] = np.arange(len(scene.meshes)) % 3
    return replace(scene, images=[grey], lights=[Light("directional", node=0, intensity=3.0)])


@pytest.mark.core
def test_many_small_pages_are_the_same_picture_as_one(chapter, monkeypatch):
    scene = drawn_scene()
    whole, count, _ = fresh(chapter, scene)
    assert count == 1
    monkeypatch.setattr(pages, "PAGE_BYTES", largest(scene, ALL))
    parts, count, work = fresh(chapter, scene)
    assert count > 4
    assert work["draw_calls"] > count, "a call for each page at least"
    assert all(np.array_equal(a, b) for a, b in zip(whole, parts, strict=True))
    assert len(np.unique(whole[2])) > 8 and np.ptp(whole[0]) > 0.1


def test_a_skin_in_a_page_of_its_own_is_posed_in_both_slots(chapter, monkeypatch):
    """One joint turns with time; three squares in three pages, of which the second is bound to it."""
    scene = quad_scene(
        materials=(Material(unlit=True),) * 3, matrices=(np.eye(4),) * 3, instance_materials=(0, 1, 2)
    )
    for name in ("positions", "normals", "tangents", "uv0"):
        setattr(scene, name, np.tile(getattr(scene, name), (48, 1)))
    scene.positions[:64] = scene.positions[128:] = 0.0  # the outer two squares are points
    scene.meshes["first_vertex"], scene.meshes["vertex_count"] = (0, 64, 128), 64
    count = 64
    bound = Deformation(
        mesh=1,
        node=1,
        joints=np.array([2], np.int32),
        inverse_bind=np.eye(4)[None],
        vertex_joints=np.zeros((count, 4), np.int32),
        vertex_weights=np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
    )
    scene = replace(scene, deformations=[bound])
    monkeypatch.setattr(pages, "PAGE_BYTES", 1100)
    with chapter.open(scene, SIZE, EXACT, outputs={"instance_id"}) as made:
        assert len(made._data.pages) == 3
        areas = []
        for size in (1.0, 0.5, 0.25, 0.25, 0.75):
            with scene.edit() as change:
                change.set_transform(2, matrix=np.diag((size, size, 1.0, 1.0)))
            ids = made.render(facing()).image("instance_id")
            assert set(np.unique(ids)) <= {0, 2}
            areas.append(int((ids == 2).sum()))
    assert areas == [32**2, 16**2, 8**2, 8**2, 24**2]


def test_a_scene_that_is_refused_leaves_nothing_behind(chapter, monkeypatch):
    scene = drawn_scene()
    monkeypatch.setattr(pages, "PAGE_BYTES", 300)
    before = len(chapter.device.alive)
    with pytest.raises(SceneError, match="and a page of geometry holds"):
        chapter.open(scene, SIZE, EXACT)
    assert len(chapter.device.alive) == before


def test_poses_of_no_mesh_write_nothing():
    scene = random_scene(5)
    pose = Pose(0.0, np.eye(4)[None], np.eye(4)[None], {})
    assert not list(deformed(scene, pose, plan_pages(scene, ["positions"])))
