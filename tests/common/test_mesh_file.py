"""Mesh files and instance lists: bytes by hand, round trips, running sums, and what is refused in one sentence."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from common.errors import SceneError
from common.mesh import file as mesh_file
from common.mesh.instances import INSTANCE_DTYPE, instance_list, read_instance_file, write_instance_file
from common.mesh.pools import mesh_indices, mesh_positions
from tests.support.meshes import grid, scene_of
from tests.support.scenes import translated

RECORD = struct.Struct("<5I8I4x8Q8I")
SCENE = scene_of(
    grid(2, 3), grid(4, 4), materials=(0, 1), kinds=(*scene_of(grid(1, 1)).materials,) * 2, drawn=(1,)
)
LEVELS = {1: [mesh_indices(SCENE, 1), mesh_indices(SCENE, 1)[:48], mesh_indices(SCENE, 1)[:3]]}
FILE = mesh_file.from_scene(SCENE, LEVELS)
DATA = mesh_file.to_bytes(FILE)


@pytest.mark.feature("mesh/binary-format")
def test_the_bytes_are_those_of_the_format():
    count = len(SCENE.positions)
    assert RECORD.size == mesh_file.RECORD_DTYPE.itemsize == 152
    assert mesh_file.HEADER_DTYPE.itemsize == 20
    index_bytes = 4 * (36 + 96 + 48 + 3)
    assert struct.unpack_from("<5I", DATA) == (0x12345678, 2, 20 + 2 * 152, index_bytes, 32 * count)
    assert len(DATA) == 20 + 2 * 152 + index_bytes + 32 * count
    first, second = (RECORD.unpack_from(DATA, 20 + 152 * mesh) for mesh in (0, 1))
    assert first[:5] == (1, 1, 0, 4 * 36 + 32 * 12, 12)
    assert first[5:13] == (0, 144, 0, 0, 0, 0, 0, 0)
    assert second[:5] == (3, 1, 1, 4 * 147 + 32 * 25, 25)
    assert second[5:13] == (144, 528, 720, 732, 0, 0, 0, 0)
    assert second[13:21] == (12 * 32, *[0] * 7) and second[21:] == (32, *[0] * 7)
    vertex = struct.unpack_from("<8f", DATA, 324 + index_bytes + 32 * 14)
    assert vertex == (*SCENE.positions[14], *SCENE.uv0[14], *SCENE.normals[14])


@pytest.mark.feature("mesh/binary-format")
def test_a_file_comes_back_byte_for_byte(tmp_path):
    mesh_file.write_mesh_file(tmp_path / "äß.mesh", FILE)
    back = mesh_file.read_mesh_file(tmp_path / "äß.mesh")
    assert mesh_file.to_bytes(back) == (tmp_path / "äß.mesh").read_bytes() == DATA
    for level, indices in enumerate(LEVELS[1]):
        assert np.array_equal(back.level(1, level), indices)
    assert back.base_vertex(1) == 12 and back.level(1).max() < 25
    positions = np.ascontiguousarray(back.stream(1)[:, :12]).view("<f4")
    assert np.array_equal(positions, mesh_positions(SCENE, 1))


@pytest.mark.parametrize(
    ("uv", "normals", "size"), [(False, False, 12), (True, False, 20), (False, True, 24), (True, True, 32)]
)
def test_a_vertex_holds_what_was_asked_for(uv, normals, size):
    data = mesh_file.to_bytes(mesh_file.from_scene(SCENE, uv=uv, normals=normals))
    assert RECORD.unpack_from(data, 20)[21] == size
    assert len(data) == 20 + 2 * 152 + 4 * 132 + size * len(SCENE.positions)


def changed(offset: int, value: int, kind: str = "<I") -> bytes:
    data = bytearray(DATA)
    struct.pack_into(kind, data, offset, value)
    return bytes(data)


@pytest.mark.feature("mesh/binary-format")
@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"", "has 0 bytes, fewer than the 20 of a header"),
        (DATA[:19], "has 19 bytes, fewer"),
        (changed(0, 0x78563412), "begins with 0x78563412 instead of 0x12345678"),
        (changed(4, 2**32 - 1), "has its data at byte 324, which does not fit 4294967295 meshes"),
        (changed(8, 328), "has its data at byte 328"),
        (changed(12, 728), "and its header speaks of"),
        (DATA[:-1], "and its header speaks of"),
        (DATA + b"\0", "and its header speaks of"),
        (changed(20, 0), "mesh 0 has not 1 to 7 levels"),
        (changed(20, 8), "mesh 0 has not 1 to 7 levels"),
        (changed(24, 9), "mesh 0 has not 1 to 8 streams"),
        (changed(32, 529), "mesh 0 has other sizes"),
        (changed(36, 11), "mesh 0 has other sizes"),
        (changed(44, 140), "mesh 0 has levels that are no whole triangles"),
        (changed(44, 0), "mesh 0 has other sizes"),
        (changed(20 + 152 + 20 + 8, 520), "mesh 1 has levels that are no whole triangles in order"),
        (changed(20 + 152 + 20 + 12, 744), "mesh 1 has levels beyond"),
        (changed(20 + 152 + 56, 13 * 32, "<Q"), "mesh 1 has a stream beyond"),
        (changed(20 + 152 + 56, 2**64 - 32, "<Q"), "mesh 1 has a stream beyond"),
        (changed(20 + 152 + 56, 11 * 32 + 4, "<Q"), "mesh 1 has a stream that begins within a vertex"),
        (changed(20 + 120, 0), "mesh 0 has a stream beyond"),
        (changed(20 + 120, 2**32 - 1), "mesh 0 has a stream beyond"),
        (changed(324 + 4 * 35, 12), "mesh 0 has an index beyond its vertices"),
        (changed(324 + 4 * 182, 2**32 - 1), "mesh 1 has an index beyond its vertices"),
    ],
)
def test_what_is_malformed_is_refused(tmp_path, data, fault):
    path = tmp_path / "a.mesh"
    path.write_bytes(data)
    with pytest.raises(SceneError) as caught:
        mesh_file.read_mesh_file(path)
    text = str(caught.value)
    assert text.startswith(f"{path} ") and fault in text
    assert text.endswith("write it again, or name another file") and "\n" not in text


def test_no_change_of_a_byte_can_lead_a_draw_outside():
    rng = np.random.default_rng(0)
    accepted = 0
    for _ in range(400):
        data = bytearray(DATA)
        data[rng.integers(0, 324 + 732)] = rng.integers(0, 256)
        try:
            file = mesh_file.from_bytes(bytes(data))
        except SceneError:
            continue
        accepted += 1
        for mesh, record in enumerate(file.records):
            for level in range(record["lod_count"]):
                indices = file.level(mesh, level)
                assert len(indices) % 3 == 0
                assert (indices.astype(np.int64) + file.base_vertex(mesh)).max() * 32 + 32 <= len(
                    file.vertices
                )
    assert accepted > 10  # materials, unused entries and indices that stay inside


def test_more_levels_than_a_record_holds_and_a_folder_that_is_missing(tmp_path):
    with pytest.raises(ValueError, match="mesh 0 has 8 levels of detail, more than 7"):
        mesh_file.from_scene(SCENE, {0: [mesh_indices(SCENE, 0)] * 8})
    assert mesh_file.from_scene(SCENE, {0: [mesh_indices(SCENE, 0)] * 7}).records["lod_count"][0] == 7
    with pytest.raises(SceneError, match=r"a.mesh cannot be written: No such file"):
        mesh_file.write_mesh_file(tmp_path / "none" / "a.mesh", FILE)
    with pytest.raises(SceneError, match=r"a.mesh cannot be read: No such file"):
        mesh_file.read_mesh_file(tmp_path / "a.mesh")


@pytest.mark.feature("mesh/merge-files")
def test_three_files_are_merged_by_running_sums():
    scenes = [scene_of(grid(1, n), grid(n, n, seed=n), drawn=(0,)) for n in (2, 3, 5)]
    files = [mesh_file.from_scene(scene, uv=False) for scene in scenes]
    merged = mesh_file.from_bytes(mesh_file.to_bytes(mesh_file.merged(files)))
    indices = np.cumsum([0] + [len(file.indices) for file in files])
    vertices = np.cumsum([0] + [len(scene.positions) for scene in scenes])
    assert len(merged.records) == 6 and len(merged.indices) == indices[-1]
    for number, (file, scene) in enumerate(zip(files, scenes, strict=True)):
        for mesh in (0, 1):
            new = 2 * number + mesh
            assert merged.base_vertex(new) == file.base_vertex(mesh) + vertices[number]
            offset = merged.records["lod_offset"][new, :2].astype(int) - 4 * indices[number]
            assert np.array_equal(offset, file.records["lod_offset"][mesh, :2])
            drawn = merged.vertices.reshape(-1, 24)[merged.level(new) + merged.base_vertex(new)]
            positions = np.ascontiguousarray(drawn[:, :12]).view("<f4")
            assert np.array_equal(positions, mesh_positions(scene, mesh)[mesh_indices(scene, mesh)])
    nested = mesh_file.merged([mesh_file.merged(files[:2]), files[2]])
    assert mesh_file.to_bytes(nested) == mesh_file.to_bytes(merged)
    assert mesh_file.to_bytes(mesh_file.merged([FILE])) == DATA


@pytest.mark.feature("mesh/merge-files")
def test_vertices_of_other_sizes_are_refused_where_a_base_vertex_would_be_a_fraction():
    files = [mesh_file.from_scene(SCENE, uv=False), FILE]
    with pytest.raises(
        SceneError, match=r"^b.mesh has vertices of another size than the files before it: write"
    ):
        mesh_file.merged(files, ["a.mesh", "b.mesh"])


@pytest.mark.feature("mesh/instance-list")
def test_an_instance_list_comes_back_and_has_80_bytes_each(tmp_path):
    matrices = tuple(translated(1e5 + x, 2, 3) for x in (0, 1.25, 2.5))
    scene = replace(scene_of(grid(1, 2), grid(2, 2), matrices=matrices, drawn=(0, 1, 1)))
    file = mesh_file.from_scene(scene)
    records = instance_list(scene, file)
    assert INSTANCE_DTYPE.itemsize == struct.calcsize("<16f4I") == 80
    write_instance_file(tmp_path / "a.instances", records)
    data = (tmp_path / "a.instances").read_bytes()
    assert len(data) == 240
    assert np.array_equal(read_instance_file(tmp_path / "a.instances", file), records)
    last = struct.unpack_from("<16f4I", data, 160)
    assert last[16:] == (1, 0, 0, 12)
    assert last[3] == np.float32(1e5 + 2.5 - scene.origin[0]) and last[15] == 1  # row by row, near zero
    assert (
        len(
            instance_list(replace(scene, instances=replace(scene.instances, visible=np.zeros(3, bool))), file)
        )
        == 0
    )


@pytest.mark.feature("mesh/instance-list")
def test_a_list_of_another_size_or_about_other_meshes_is_refused(tmp_path):
    path = tmp_path / "a.instances"
    good = instance_list(SCENE, FILE)
    for size in (1, 79, 81, 160 - 4):
        path.write_bytes(good.tobytes().ljust(size, b"\0")[:size])
        with pytest.raises(SceneError, match=f"{size} bytes, no multiple of 80, and is no inst"):
            read_instance_file(path)
    for name, value, fault in (
        ("transform", np.nan, "instance 0 has a transform that is not finite"),
        ("mesh", 2, "instance 0 names a mesh, level or index"),
        ("lod", 3, "instance 0 names a mesh, level or index"),
        ("index_offset", 1, "instance 0 names a mesh, level or index"),
    ):
        bad = good.copy()
        bad[name] = value
        write_instance_file(path, bad)
        with pytest.raises(SceneError, match=fault):
            read_instance_file(path, FILE)
    path.write_bytes(b"")
    assert len(read_instance_file(path, FILE)) == 0
