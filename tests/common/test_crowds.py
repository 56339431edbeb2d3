"""Scenes made to grow: as many squares, materials and textures as were asked for, and none touches another."""

from __future__ import annotations

import numpy as np
import pytest

from common.scene.crowds import GAP, TEXTURE_SIZES, crowd, kinds
from tests.support.timing import least_time, timed


@pytest.mark.parametrize(("draws", "materials", "used"), [(1, 1, 1), (1, 64, 1), (10, 4, 4), (1000, 64, 64)])
def test_a_crowd_has_what_was_asked_for(draws, materials, used):
    scene = crowd(draws, materials)
    assert len(scene.instances) == draws
    assert len(scene.materials) == len(scene.images) == used
    drawn = scene.meshes["material"][scene.instances.mesh]
    assert np.array_equal(np.unique(drawn), np.arange(used))
    assert used == 1 or (drawn[1:] != drawn[:-1]).all()  # neighbours differ
    assert [one.base_color_texture.image for one in scene.materials] == list(range(used))


def test_no_two_textures_are_the_same_and_their_sizes_take_turns():
    images = crowd(100, 100).images
    assert len({image.pixels.tobytes() for image in images}) == 100
    assert [image.pixels.shape[1::-1] for image in images[:3]] == list(TEXTURE_SIZES)


def test_squares_lie_apart_in_one_plane():
    local = crowd(37, 5).instances.local
    centres = local[:, :3, 3]
    far = np.abs(centres[:, None] - centres[None]).max(axis=-1) + np.eye(37) * 9
    width = 2 * local[0, 0, 0]  # of a square from -1 to 1
    assert far.min() * (1 - GAP) == pytest.approx(width)
    assert (centres[:, 2] == 0).all()
    assert np.abs(centres).max() + width / 2 < 1


@pytest.mark.parametrize("scene", [crowd(3, 2), kinds()], ids=["crowd", "kinds"])
def test_every_square_is_flat_and_as_large_as_it_says(scene):
    """Two triangles from -1 to 1 at z = 0, seen from where the normal points; u runs along the tangent, v down."""
    corners = scene.positions[scene.indices].reshape(2, 3, 3).astype(np.float64)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.array_equal(areas, [(0, 0, 2), (0, 0, 2)]) and np.array_equal(scene.normals, [(0, 0, 1)] * 4)
    assert (np.abs(scene.positions) == (1, 1, 0)).all()
    assert np.array_equal(scene.tangents, [(1, 0, 0, 1)] * 4)
    assert np.array_equal(scene.uv0 * (2, -2) + (-1, 1), scene.positions[:, :2])
    assert (scene.meshes["bounds_min"] == scene.positions.min(axis=0)).all()
    assert (scene.meshes["bounds_max"] == scene.positions.max(axis=0)).all()


def test_kinds_are_all_different():
    scene = kinds()
    assert len(scene.materials) == len(scene.instances) == 5
    found = {(tuple(one.textures()), one.alpha_mode) for one in scene.materials}
    assert len(found) == 5
    assert {mode for _, mode in found} == {"opaque", "mask", "blend"}


@pytest.mark.alone
def test_a_hundred_thousand_are_made_in_a_second():
    assert least_time(timed(lambda: crowd(100_000, 4096)), 1.0, fewest=1) < 1.0


@pytest.mark.parametrize(("draws", "materials"), [(0, 1), (1, 0), (-1, 5)])
def test_there_is_no_crowd_of_nothing(draws, materials):
    with pytest.raises(ValueError, match="at least one square and one material"):
        crowd(draws, materials)
