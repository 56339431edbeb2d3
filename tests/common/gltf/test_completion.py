"""Normals and tangents that a file leaves out, against surfaces whose derivatives are known in closed form."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from common.gltf.geometry import completion
from common.gltf.geometry.completion import (
    any_tangents,
    flat_normals,
    generate_tangents,
    smooth_normals,
    unit,
)
from common.paths import asset_dir


def grid(columns, rows):
    """Indices of a (rows + 1) x (columns + 1) grid of vertices, two triangles a cell."""
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)
    quad = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=-1).reshape(-1, 4)
    return quad[:, [0, 1, 2, 0, 2, 3]].reshape(-1).astype(np.uint32)


def torus(columns=96, rows=48, major=2.0, minor=0.7):
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    a, b = 2 * np.pi * u.ravel(), 2 * np.pi * v.ravel()
    ring = np.stack([np.cos(a), np.zeros_like(a), -np.sin(a)], axis=1)
    positions = ring * (major + minor * np.cos(b))[:, None] + minor * np.sin(b)[:, None] * (0.0, 1.0, 0.0)
    normals = ring * np.cos(b)[:, None] + np.sin(b)[:, None] * (0.0, 1.0, 0.0)
    along_u = np.stack([-np.sin(a), np.zeros_like(a), -np.cos(a)], axis=1)
    along_v = -ring * np.sin(b)[:, None] + np.cos(b)[:, None] * (0.0, 1.0, 0.0)
    return (
        positions.astype("f4"),
        normals,
        along_u,
        along_v,
        np.stack([u.ravel(), v.ravel()], 1),
        grid(columns, rows),
    )


@pytest.mark.parametrize("flip", [False, True])
def test_tangents_of_a_torus_follow_u(flip):
    """uv as glTF stores it has v running down the image; w (n x t) must run up, against v."""
    positions, normals, along_u, along_v, uv, indices = torus()
    if flip:
        uv = uv * (1, -1)
    source, tangents, new_indices = generate_tangents(positions, normals, uv, indices)
    assert len(source) == len(positions)
    assert np.array_equal(new_indices, indices)
    angle = np.degrees(np.arccos((tangents[:, :3] * along_u).sum(axis=1).clip(-1, 1))).reshape(49, 97)
    assert angle[:, 1:-1].max() < 0.05
    assert (
        angle.max() < 360 / 96 / 2 * 1.001
    )  # a vertex of the seam sees triangles on one side only: half a cell
    bitangent = tangents[:, 3:] * np.cross(normals, tangents[:, :3])
    up_in_image = along_v if flip else -along_v
    assert ((bitangent * up_in_image).sum(axis=1) > np.cos(np.radians(1.9))).all()
    assert np.allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-6)
    assert np.allclose((tangents[:, :3] * normals).sum(axis=1), 0, atol=1e-6)


def test_equal_vertices_stored_apart_share_their_tangent():
    positions, normals, _, _, uv, indices = torus(24, 12)
    shared = generate_tangents(positions, normals, uv, indices)[1]
    apart = generate_tangents(
        positions[indices], normals[indices], uv[indices], np.arange(len(indices), dtype=np.uint32)
    )[1]
    assert np.abs(apart - shared[indices]).max() < 1e-6


def test_a_mirrored_texture_splits_its_seam():
    """A strip of four quads whose u runs 0, 1, 2, 1, 0: the middle column belongs to both hands."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(2.0))
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(10)], axis=1).astype("f4")
    uv = np.stack([2 - np.abs(x.ravel() - 2), 1 - y.ravel()], axis=1)
    normals = np.tile((0.0, 0.0, 1.0), (10, 1))
    indices = grid(4, 1)
    source, tangents, new_indices = generate_tangents(positions, normals, uv, indices)
    assert sorted(source[10:]) == [2, 7]
    assert np.array_equal(source[new_indices], indices)
    centers = positions[indices].reshape(-1, 3, 3).mean(axis=1)[:, 0]
    for corner, side in zip(new_indices.reshape(-1, 3), centers, strict=True):
        expected = (1, 0, 0, 1) if side < 2 else (-1, 0, 0, -1)
        assert np.allclose(tangents[corner], expected)


def test_triangles_without_area_in_space_or_uv_harm_nobody():
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (3, 0, 0)], "f4")
    uv = np.array([(0, 1), (1, 1), (0, 0), (5, 5), (5, 5)], float)
    normals = np.tile((0.0, 0.0, 1.0), (5, 1))
    indices = np.array([0, 1, 2, 1, 3, 4, 0, 0, 2, 3, 4, 4], np.uint32)
    source, tangents, _ = generate_tangents(positions, normals, uv, indices)
    assert len(source) == 5
    assert np.allclose(tangents[:3], (1, 0, 0, 1))
    assert np.isfinite(tangents).all()
    assert np.allclose(np.linalg.norm(tangents[:, :3], axis=1), 1)


@pytest.mark.parametrize("seed", range(5))
def test_tangents_are_computed_in_float64_from_the_file_s_float32(seed):
    """Of a tangent that hardly leaves its normal next to nothing remains after projection, and 24 bits of an edge do
    not say what. One triangle, the closed form in float64."""
    random = np.random.default_rng(seed)
    positions = random.uniform(-1000, 1000, (3, 3)).astype("f4")
    uv = np.array([(0.1, 0.7), (0.9, 0.4), (0.3, 0.2)])
    e1, e2 = positions[1:].astype(float) - positions[0].astype(float)
    (u1, v1), (u2, v2) = uv[1:] - uv[0]
    along_u = (e1 * v2 - e2 * v1) / (u1 * v2 - u2 * v1)
    along_u /= np.linalg.norm(along_u)
    normal = along_u + 1e-6 * np.cross(along_u, random.normal(size=3))
    normal /= np.linalg.norm(normal)
    truth = along_u - normal * (normal @ along_u)
    truth /= np.linalg.norm(truth)
    indices = np.arange(3, dtype=np.uint32)
    tangents = generate_tangents(positions, np.tile(normal, (3, 1)), uv, indices)[1]
    assert np.abs(tangents[:, :3] - truth).max() < 1e-6


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_tangents_do_not_depend_on_scale(scale):
    positions, normals, along_u, _, uv, indices = torus(24, 12)
    tangents = generate_tangents((positions * scale).astype("f4"), normals, uv, indices)[1]
    assert (
        (tangents[:, :3] * along_u).sum(axis=1) > np.cos(np.radians(7.6))
    ).all()  # half a cell at the seam


@pytest.mark.parametrize("batch", [1, 7, 500])
def test_tangents_do_not_depend_on_how_many_are_computed_at_once(monkeypatch, batch):
    """Mirrored and flat triangles among them, and vertices that become two."""
    random = np.random.default_rng(5)
    positions = random.normal(size=(300, 3)).astype("f4")
    normals, uv = unit(random.normal(size=(300, 3))), random.integers(0, 4, (300, 2)).astype(float)
    indices = random.integers(0, 300, 3 * 800).astype(np.uint32)
    whole = generate_tangents(positions, normals, uv, indices)
    assert len(whole[0]) > 300
    monkeypatch.setattr(completion, "_BATCH", batch)
    for one, other in zip(generate_tangents(positions, normals, uv, indices), whole, strict=True):
        assert one.dtype == other.dtype
        assert np.array_equal(one, other)


def test_tangents_take_little_memory_beside_what_they_make():
    """A triangle's nine numbers of 8 bytes are kept for its corners, and where they go; no more than twice that."""
    positions, normals, _, _, uv, indices = torus(300, 150)
    tracemalloc.start()
    try:
        generate_tangents(positions, normals, uv, indices)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * (9 * 8 + 3 * 8) * len(indices) // 3


def test_generated_tangents_agree_with_authored_ones():
    """FlightHelmet's tangents were made by MikkTSpace: same hand, same direction but for a few degrees."""
    assets = asset_dir()
    if assets is None:
        pytest.skip("no models; set STRATA_ASSETS")
    from common.gltf import load_scene

    scene = load_scene(assets / "models" / "FlightHelmet" / "FlightHelmet.gltf")
    mesh = scene.meshes[0]
    vertices = slice(mesh["first_vertex"], mesh["first_vertex"] + mesh["vertex_count"])
    indices = scene.indices[mesh["first_index"] : mesh["first_index"] + mesh["index_count"]]
    authored = scene.tangents[vertices]
    source, tangents, _ = generate_tangents(
        scene.positions[vertices], unit(scene.normals[vertices]), scene.uv0[vertices].astype(float), indices
    )
    same_hand = authored[source, 3] == tangents[:, 3]
    angle = np.degrees(np.arccos((authored[source, :3] * tangents[:, :3]).sum(axis=1).clip(-1, 1)))
    assert same_hand.mean() > 0.99
    assert np.median(angle[same_hand]) < 1.5
    assert np.quantile(angle[same_hand], 0.95) < 10


def test_any_tangents_are_perpendicular_and_unit():
    normals = np.random.default_rng(2).normal(size=(1000, 3))
    normals = np.concatenate([unit(normals), np.eye(3), -np.eye(3)]).astype("f4")
    tangents = any_tangents(normals)
    assert np.abs((tangents[:, :3] * normals).sum(axis=1)).max() < 1e-6
    assert np.abs(np.linalg.norm(tangents[:, :3], axis=1) - 1).max() < 1e-6


def test_flat_normals_of_a_tetrahedron():
    corners = np.array([(1, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1)], "f4")
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    normals = flat_normals(corners[faces].reshape(-1, 3)).reshape(4, 3, 3)
    for face, found in zip(faces, normals, strict=True):
        opposite = corners[({0, 1, 2, 3} - set(face.tolist())).pop()]
        assert np.allclose(found, -opposite / np.sqrt(3), atol=1e-6)


def test_smooth_normals_of_a_torus():
    positions, normals, _, _, _, indices = torus()
    inside = np.ones((49, 97), bool)
    inside[[0, -1]] = inside[:, [0, -1]] = False  # vertices of the seam see one side only
    found = smooth_normals(positions, indices)
    angle = np.arccos((found * normals).sum(axis=1).clip(-1, 1))[inside.ravel()]
    assert angle.max() < np.radians(1)
