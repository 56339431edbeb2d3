"""Modes of primitives: winding of strips and fans by the standard's formulas, points and lines as closed solids."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from common.gltf import load_scene
from common.gltf.geometry.topology import line_ends, solid_lines, solid_points, triangle_indices
from tests.common.gltf.builder import Gltf


def triangles(values, mode):
    return triangle_indices(np.array(values, np.uint32), mode).reshape(-1, 3).tolist()


def test_list_keeps_order_and_degenerate_triangles():
    assert triangles([0, 1, 2, 3, 3, 4], 4) == [[0, 1, 2], [3, 3, 4]]
    assert triangles([0, 1, 2, 3, 4], 4) == [[0, 1, 2]]


def test_strip_and_fan_follow_the_standard():
    """glTF 2.0, 3.7.2.1: p_i = {v_i, v_i+(1+i%2), v_i+(2-i%2)} and p_i = {v_i+1, v_i+2, v_0}."""
    v = [10, 11, 12, 13, 14, 15]
    assert triangles(v, 5) == [[v[i], v[i + 1 + i % 2], v[i + 2 - i % 2]] for i in range(4)]
    assert triangles(v, 6) == [[v[i + 1], v[i + 2], v[0]] for i in range(4)]


def test_glue_of_strips_is_dropped_and_winding_kept():
    """Two quads joined by two repeated indices: every triangle of a flat strip must face the same way."""
    points = np.array([(x, y) for x in range(4) for y in (1, 0)], float)
    joined = [0, 1, 2, 3, 3, 4, 4, 5, 6, 7]
    found = np.array(triangles(joined, 5))
    assert len(found) == 4
    a, b, c = points[found].transpose(1, 0, 2)
    u, v = b - a, c - a
    assert (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0).all()


@pytest.mark.parametrize("mode", [4, 5, 6])
def test_too_few_indices_give_no_triangle(mode):
    assert triangles([0, 1], mode) == []
    assert triangles([], mode) == []


def test_ends_of_lines():
    v = np.array([5, 6, 7, 8], np.uint32)
    assert line_ends(v, 1).tolist() == [[5, 6], [7, 8]]
    assert line_ends(v, 2).tolist() == [[5, 6], [6, 7], [7, 8], [8, 5]]
    assert line_ends(v, 3).tolist() == [[5, 6], [6, 7], [7, 8]]


def assert_closed_and_outward(positions, indices, volume):
    faces = indices.reshape(-1, 3)
    edges = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3))
    assert all(
        edges[b, a] == count == 1 for (a, b), count in edges.items()
    )  # each edge once in each direction
    a, b, c = positions[faces].astype(float).transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=1e-5)  # positive: outward


def test_a_point_is_a_closed_octahedron():
    positions = np.array([(0, 0, 0), (4, 0, 0), (0, 3, 0)], np.float32)
    solid = solid_points(positions, np.array([1], np.uint32))
    assert_closed_and_outward(positions[solid.source] + solid.offset, solid.indices, 4 / 3 * (1 / 80) ** 3)
    both = solid_points(positions, np.array([1, 2], np.uint32))
    assert len(both.indices) == 48
    assert set(both.source[both.indices[24:]]) == {2}
    assert np.abs(both.offset).max() == pytest.approx(5 / 80)  # the points' diagonal is 5


@pytest.mark.parametrize("direction", [(3, 0, 0), (0, -2, 0), (0, 0, 1), (1, 2, -3)])
def test_a_line_is_a_closed_prism(direction):
    positions = np.array([(1, 1, 1), np.add((1, 1, 1), direction)], np.float32)
    solid = solid_lines(positions, np.array([[0, 1]], np.uint32))
    length = np.linalg.norm(direction)
    radius = length / 200
    moved = positions[solid.source] + solid.offset - positions[0]
    assert_closed_and_outward(moved, solid.indices, 2 * radius**2 * length)
    assert np.allclose(solid.normals @ np.array(direction), 0, atol=1e-6)


def test_points_and_lines_of_a_file_are_unlit_without_normals(tmp_path):
    gltf = Gltf()
    position = gltf.accessor([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "f4")
    normal = gltf.accessor([(0, 0, 1)] * 3, "f4")
    gltf.add("materials", {"name": "wire"})
    for mode in range(4):
        gltf.draw(gltf.primitive(POSITION=position, mode=mode, material=0))
    gltf.draw(gltf.primitive(POSITION=position, NORMAL=normal, mode=1, material=0))
    scene = load_scene(gltf.write(tmp_path))
    assert [material.unlit for material in scene.materials] == [False, True]
    assert scene.meshes["material"].tolist() == [1, 1, 1, 1, 0]
    assert (scene.meshes["index_count"] // 3).tolist() == [3 * 8, 12, 3 * 12, 2 * 12, 12]
    row = scene.meshes[4]
    used = slice(row["first_vertex"], row["first_vertex"] + row["vertex_count"])
    assert np.array_equal(scene.normals[used], [(0, 0, 1)] * 8)
