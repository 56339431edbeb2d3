"""OBJ files written by hand: counts, corners, normals, materials, and what is wrong in one sentence."""

from __future__ import annotations

import random

import numpy as np
import pytest

from common.errors import SceneError
from common.mesh.obj import load_obj
from common.scene import Scene

CUBE = """
# a cube of six quads
mtllib cube.mtl
o box
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
usemtl red
f 4 3 2 1
f 5 6 7 8
usemtl glass
f 1 2 6 5
f 3 4 8 7
f 2 3 7 6
f 1 5 8 4
"""
MTL = """
newmtl red
Kd 0.8 0.1 0.05
Ke 1 2 3
Ns 98
newmtl glass
d 0.25
Pm 0.5
Pr 0.1
map_Kd wood.png
"""


def load(tmp_path, text: str | bytes, **libraries: str) -> Scene:
    for name, content in libraries.items():
        (tmp_path / f"{name}.mtl").write_text(content)
    path = tmp_path / "x.obj"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_obj(path)


@pytest.mark.feature("scene/obj-import")
def test_triangles_are_a_third_of_the_indices(tmp_path):
    scene = load(tmp_path, CUBE, cube=MTL)
    assert scene.triangle_count == len(scene.indices) / 3 == 12
    assert scene.meshes["index_count"].tolist() == [12, 24]
    assert scene.bounds.tolist() == [[-1, -1, -1], [1, 1, 1]]
    # Counter-clockwise seen from outside, with the normals that this gives.
    corners = np.concatenate(
        [
            scene.positions[row["first_vertex"] + scene.indices[row["first_index"] :][: row["index_count"]]]
            for row in scene.meshes
        ]
    ).reshape(-1, 3, 3)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((faces * corners.mean(axis=1)).sum(axis=1) > 0).all()
    assert np.allclose(scene.normals, (faces / 4).repeat(3, axis=0))


@pytest.mark.feature("scene/obj-import")
def test_a_missing_file_is_one_sentence(tmp_path):
    load(tmp_path, CUBE, cube=MTL)
    with pytest.raises(SceneError) as caught:
        load_obj(tmp_path / "y.obj")
    assert (
        str(caught.value)
        == f"{tmp_path / 'y.obj'}: there is no such file; check the path, or name 'x.obj', which is there."
    )
    with pytest.raises(SceneError, match="is a folder"):
        load_obj(tmp_path)


def test_materials(tmp_path):
    scene = load(tmp_path, CUBE, cube=MTL)
    red, glass = scene.materials
    assert red.base_color == (0.8, 0.1, 0.05, 1.0) and red.emissive == (1, 2, 3) and red.metallic == 0
    assert red.roughness**2 == pytest.approx(np.sqrt(2 / 100)) and red.alpha_mode == "opaque"
    assert (glass.base_color[3], glass.alpha_mode, glass.metallic, glass.roughness) == (
        0.25,
        "blend",
        0.5,
        0.1,
    )
    assert scene.warnings == ["Textures of cube.mtl (map_Kd) were left out."]


def test_a_missing_library_costs_only_its_colours(tmp_path):
    scene = load(tmp_path, CUBE)
    assert scene.triangle_count == 12 and [m.name for m in scene.materials] == ["default"] * 2
    assert "cube.mtl, which is missing" in scene.warnings[0] and len(scene.warnings) == 3
    outside = load(tmp_path, CUBE.replace("cube.mtl", "../cube.mtl"))
    assert "outside the scene's folder" in outside.warnings[0]


def test_corners_share_vertices_where_all_three_places_are_equal(tmp_path):
    text = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0 0
vt 1 1
vt 0 1
vn 0 0 2
f 1/1/1 2/2/1 3/3/1
f -4/-4/-1 -2/-2/-1 -1/-1/-1
f 1//1 2//1 3//1
"""
    scene = load(tmp_path, text)
    assert scene.indices.tolist() == [0, 1, 2, 0, 2, 3, 4, 5, 6]
    assert scene.positions[:4].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert scene.uv0[:4].tolist() == [[0, 1], [1, 1], [1, 0], [0, 0]]  # v counts from the top here
    assert (scene.normals == (0, 0, 1)).all()


def test_polygons_are_fans_and_lines_go_on(tmp_path):
    text = "v 0 0 0\nv 2 0 0\nv 3 1 0\r\nv 1 2 \\\n 0\nv -1 1 0 0.5 0.5 0.5\nl 1 2\nf 1 2 3 \\\r\n4 5\n"
    scene = load(tmp_path, "\ufeff" + text)
    assert scene.triangle_count == 3
    assert scene.positions[:, 0].tolist() == [0, 2, 3, 0, 3, 1, 0, 1, -1]
    assert scene.warnings == ["Statements l were left out."]


def test_normals_without_a_direction(tmp_path):
    scene = load(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 0\nf 1//1 2//1 3//1\n")
    assert (scene.normals == (0, 0, 1)).all()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("v 0 0 0\nf 1 2 3", "line 2 has a face with the corner '2', which names no vertex before it"),
        ("v 0 0 0\nf 1 1 0", "corner '0'"),
        ("v 0 0 0\nf 1 1 -2", "corner '-2'"),
        ("v 0 0 0\nf 1 1 a", "corner 'a'"),
        ("v 0 0 0\nf 1 1 1/1/1/1", "corner '1/1/1/1'"),
        ("v 0 0 0\nf 1 1 /1", "corner '/1'"),
        ("v 0 0 0\nf 1 1", "line 2 is a face of 2 corners"),
        ("v 0 0 0\n\nv 1 2\nf 1 1 1", "line 3 has no 3 finite numbers"),
        ("v 0 0 0\nv 1 2 x", "line 2 has no 3 finite numbers"),
        ("v 0 nan 0", "line 1 has no 3 finite"),
        ("v 0 1e30 0", "line 1 has no 3 finite"),
        ("vt\nv 0 0 0", "line 1 has no 2 finite"),
        ("\x89PNG and so on", "is no OBJ file"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, fault):
    with pytest.raises(SceneError) as caught:
        load(tmp_path, text)
    assert fault in str(caught.value) and str(caught.value).startswith(str(tmp_path / "x.obj") + ": ")


@pytest.mark.parametrize("text", ["", "# nothing\n", "v 0 0 0\n"])
def test_a_file_without_faces_draws_nothing(tmp_path, text):
    scene = load(tmp_path, text)
    assert len(scene.instances) == 0 and scene.triangle_count == 0


def test_damaged_files(tmp_path):
    rng, good = random.Random(1), CUBE.encode()
    for _ in range(300):
        damaged = bytearray(good)
        for _ in range(rng.randrange(1, 6)):
            damaged[rng.randrange(len(damaged))] = rng.choice(b" 0123456789/-.efvn\n\xff\0")
        try:
            scene = load(tmp_path, bytes(damaged))
        except SceneError:
            continue
        assert np.isfinite(scene.positions).all() and np.isfinite(scene.normals).all()
        for row in scene.meshes:
            assert scene.indices[row["first_index"] :][: row["index_count"]].max() < row["vertex_count"]
