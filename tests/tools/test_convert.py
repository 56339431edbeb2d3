"""`strata convert`: the triangles, boxes and textures of a scene are in the files that it becomes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from chapters import scenes
from common.images import read_image
from common.mesh import file as mesh_file
from common.mesh import instances
from common.scene import Image, Material
from common.scene.pose import evaluate_pose
from common.scene_graph import file as scene_graph_file
from tests.support.scenes import quad_scene, texture
from tools.assets import convert

pytestmark = pytest.mark.feature("convert/scene-converter")

MODES = {12: (False, False), 20: (True, False), 24: (False, True), 32: (True, True)}


@pytest.fixture(scope="module", params=["cornell", "spheres"])
def scene(request):
    return scenes.load(request.param)


def triangles_of_scene(scene):
    """Return (T, 3, 3) float64 the world-space triangles of all visible instances, from nodes and pools."""
    world = evaluate_pose(scene, 0.0).world_from_object
    found = []
    for instance in np.flatnonzero(scene.instances.visible):
        row = scene.meshes[scene.instances.mesh[instance]]
        begin = int(row["first_index"])
        indices = scene.indices[begin : begin + int(row["index_count"])].astype(int) + int(
            row["first_vertex"]
        )
        points = scene.positions[indices].astype(np.float64)
        found.append(points @ world[instance, :3, :3].T + world[instance, :3, 3])
    return np.concatenate(found).reshape(-1, 3, 3)


def triangles_of_files(folder):
    """The same from the files, as somebody would who knows nothing but what their modules say."""
    about = json.loads((folder / "scene.json").read_text())
    meshes = mesh_file.read_mesh_file(folder / "scene.meshes")
    found = []
    for one in instances.read_instance_file(folder / "scene.instances", meshes):
        mesh = int(one["mesh"])
        positions = meshes.stream(mesh)[:, :12].copy().view("<f4").astype(np.float64)
        matrix = one["transform"].astype(np.float64)
        found.append(positions[meshes.level(mesh)] @ matrix[:3, :3].T + matrix[:3, 3] + about["origin"])
    return np.concatenate(found).reshape(-1, 3, 3)


@pytest.mark.parametrize("element", MODES)
def test_the_triangles_of_the_world_are_in_the_files_whatever_a_vertex_holds(scene, tmp_path, element):
    uv, normals = MODES[element]
    about = convert.write(scene, tmp_path, uv, normals)
    assert about["vertex_bytes"] == element
    meshes = mesh_file.read_mesh_file(tmp_path / "scene.meshes")
    assert set(meshes.records["stream_element_bytes"][:, 0].tolist()) == {element}
    truth, found = triangles_of_scene(scene), triangles_of_files(tmp_path)
    # Float32 matrices and positions: three products and their sum, each rounded, of what is as large as the scene.
    assert np.abs(found - truth).max() <= 8 * 2.0**-24 * 2 * scene.length_scale


def test_streams_have_what_they_say(scene, tmp_path):
    convert.write(scene, tmp_path)
    meshes = mesh_file.read_mesh_file(tmp_path / "scene.meshes")
    for mesh, row in enumerate(scene.meshes):
        first, count = int(row["first_vertex"]), int(row["vertex_count"])
        vertices = meshes.stream(mesh).copy().view("<f4")
        assert (vertices[:, 3:5] == scene.uv0[first : first + count]).all()
        assert (vertices[:, 5:] == scene.normals[first : first + count]).all()


def test_boxes_touch_the_vertices_that_triangles_use(scene, tmp_path):
    convert.write(scene, tmp_path)
    boxes = np.frombuffer((tmp_path / "scene.boxes").read_bytes(), "<f4").reshape(-1, 2, 3)
    for row, box in zip(scene.meshes, boxes, strict=True):
        begin, first = int(row["first_index"]), int(row["first_vertex"])
        used = scene.positions[scene.indices[begin : begin + int(row["index_count"])].astype(int) + first]
        assert (box == (used.min(axis=0), used.max(axis=0))).all()


def test_nodes_are_in_the_graph_with_their_names_and_meshes(scene, tmp_path):
    convert.write(scene, tmp_path)
    graph = scene_graph_file.load_graph(tmp_path / "scene.graph")
    assert [graph.names[node] for node in range(len(scene.nodes))] == list(scene.nodes.names)
    assert sorted(graph.meshes.values()) == sorted(scene.instances.mesh.tolist())


def test_two_runs_write_the_same_bytes(strata, tmp_path):
    for name in ("a", "b", "a"):  # and over what is there already
        assert strata("convert", "cornell", name)[0] == 0
    files = {path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()}
    assert {str(path) for path in files} >= set(convert.FILES)
    for path in files:
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes(), path


def test_materials_name_the_textures_that_are_written(tmp_path):
    rng = np.random.default_rng(1)
    pixels = [rng.integers(0, 256, (5, 3, 4), np.uint8), rng.integers(0, 65536, (2, 7, 4), np.uint16)]
    materials = [
        Material("wood", base_color_texture=texture(1), normal_texture=texture(0)),
        Material("plain", roughness=0.25),
    ]
    images = [Image("same/../name.jpg", pixels[0]), Image("same name", pixels[1])]
    made = replace(quad_scene(), materials=materials, images=images)
    convert.write(made, tmp_path)
    about = json.loads((tmp_path / "scene.json").read_text())
    for role, number in (("base_color_texture", 1), ("normal_texture", 0)):
        file = about["textures"][about["materials"][0][role]["image"]]
        assert (read_image(tmp_path / file) == pixels[number]).all()
    assert about["materials"][1]["roughness"] == 0.25 and about["materials"][1]["normal_texture"] is None
    assert len(set(about["textures"])) == 2


def test_merged_it_has_a_mesh_a_material_and_the_same_triangles(strata, tmp_path, scene):
    assert strata("convert", scene.name, "a", "--merge", "--no-uv")[0] == 0
    found = triangles_of_files(tmp_path / "a")
    truth = triangles_of_scene(scene)
    assert len(found) == len(truth)
    for moment in (1, 2):
        ours, theirs = ((t.mean(axis=1) ** moment).mean(axis=0) for t in (found, truth))
        assert np.abs(ours - theirs).max() < 1e-5 * scene.length_scale**moment
    areas = [
        np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() for t in (found, truth)
    ]
    assert areas[0] == pytest.approx(areas[1], rel=1e-5)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("nothing.gltf", "a"), "nothing.gltf"),
        (("cornell", "file"), "file is a file"),
        (("cornell",), "FOLDER"),
        (("cornell", "file/a"), "cannot be written"),
    ],
)
def test_what_is_wrong_is_one_sentence(strata, tmp_path, words, says):
    (tmp_path / "file").write_text("")
    code, out, err = strata("convert", *words)
    assert (code, out) == (2, "") and says in err and err.count("\n") == 1


def test_what_is_left_out_is_said(strata, tmp_path):
    code, out, _ = strata("convert", "cornell", "a", "--no-uv", "--no-normals")
    assert code == 0 and "Left out: uv coordinates, normals." in " ".join(out.split())
