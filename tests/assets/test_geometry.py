"""What the generators make is sound: directions of unit length, no empty triangle, every face the right way."""

from __future__ import annotations

import numpy as np
import pytest

from assets import locate
from common.gltf import load_scene
from tests.assets.conftest import SIZES


@pytest.fixture(
    scope="module",
    params=[pytest.param(":".join(size.values), id=size.id, marks=size.marks) for size in SIZES],
)
def scene(request, kept):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STRATA_CACHE", str(kept))
        return load_scene(locate(request.param))


def test_normals_and_tangents_are_frames(scene):
    """Unit length, and perpendicular: both to what is left of them on the grid."""
    normals, tangents = scene.normals.astype(np.float64), scene.tangents.astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-3)
    assert np.abs((normals * tangents[:, :3]).sum(axis=1)).max() < 1e-3
    assert set(np.unique(tangents[:, 3])) <= {-1.0, 1.0}


def test_every_triangle_has_an_area_and_faces_where_its_normals_point(scene):
    for mesh, name in zip(scene.meshes, scene.mesh_names, strict=True):
        first, count = int(mesh["first_index"]), int(mesh["index_count"])
        corners = scene.indices[first : first + count].reshape(-1, 3) + int(mesh["first_vertex"])
        a, b, c = scene.positions[corners].astype(np.float64).transpose(1, 0, 2)
        facing = np.cross(b - a, c - a)
        assert np.linalg.norm(facing, axis=1).min() > 0, name
        wrong = (facing * scene.normals[corners].sum(axis=1)).sum(axis=1) <= 0
        assert not wrong.any(), f"{name}: {wrong.sum()} of {len(wrong)} triangles face against their normals"


def test_a_normal_map_lies_on_tangents_that_follow_its_texture(scene):
    """Where a file brings tangents, each points where u grows: against the positions' own derivative."""
    for mesh, name in zip(scene.meshes, scene.mesh_names, strict=True):
        normal_map = scene.materials[int(mesh["material"])].normal_texture
        if normal_map is None or normal_map.rotation:
            continue
        first, count = int(mesh["first_index"]), int(mesh["index_count"])
        corners = scene.indices[first : first + count].reshape(-1, 3) + int(mesh["first_vertex"])
        p, uv = scene.positions[corners].astype(np.float64), scene.uv0[corners].astype(np.float64)
        (e1, e2), (d1, d2) = (
            (p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]),
            (uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]),
        )
        area = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
        along_u = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) * np.sign(area)[:, None]
        mean = scene.tangents[corners][..., :3].sum(axis=1)
        length = np.linalg.norm(along_u, axis=1) * np.linalg.norm(mean, axis=1)
        plain = (np.abs(area) > 1e-7) & (length > 0)
        cosine = (along_u * mean).sum(axis=1)[plain] / length[plain]
        assert (cosine > 0.5).all(), (
            f"{name}: a tangent is off by {np.degrees(np.arccos(cosine.min())):.0f} degrees"
        )


def test_pictures_are_of_sane_size(scene):
    """Sides are multiples of 16 up to 1024: four levels of mipmaps halve without a rest."""
    for image in scene.images:
        assert all(side % 16 == 0 and 16 <= side <= 1024 for side in image.pixels.shape[:2]), image.name
