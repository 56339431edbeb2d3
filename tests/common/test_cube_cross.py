"""The way of a panorama by a vertical cross to the faces of a cube."""

from __future__ import annotations

import numpy as np
import pytest

from common.environment.cube_cross import cross_directions, cross_from_panorama, faces_from_cross
from common.environment.directions import (
    cube_directions,
    cube_solid_angles,
    panorama_directions,
    panorama_solid_angles,
)


@pytest.mark.feature("environment/equirect-to-cube")
@pytest.mark.parametrize("edge", [1, 8, 33])
def test_the_chain_is_a_rotation(edge):
    directions, covered = cross_directions(edge)
    assert covered.sum() == 6 * edge * edge
    faces = faces_from_cross(directions)
    faces = faces / np.linalg.norm(faces, axis=-1, keepdims=True)
    d = cube_directions(edge)
    turned = np.stack([-d[..., 2], -d[..., 0], d[..., 1]], axis=-1)
    assert np.abs(faces - turned).max() < 1e-12
    constant = cross_from_panorama(np.full((2 * edge, 4 * edge, 3), 0.7))
    assert np.allclose(faces_from_cross(constant), 0.7, rtol=1e-15)


def test_pixels_arrive_where_they_are_seen():
    """A panorama that holds its own directions (z up, u from -x by -y): errors are those of lines between pixels."""
    height = 128
    v, u = np.meshgrid(
        (np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij"
    )
    theta, phi = (u - 0.5) * 2 * np.pi, (0.5 - v) * np.pi
    panorama = np.stack([np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)], axis=-1)
    d = cube_directions(height // 2)
    faces = faces_from_cross(cross_from_panorama(panorama))
    assert np.abs(faces - np.stack([-d[..., 2], -d[..., 0], d[..., 1]], axis=-1)).max() < 0.02
    # Neighbouring faces meet: the mean light over the sphere is kept.
    light = 1 + panorama_directions(height)[..., 1:2] ** 2
    mean = (light * panorama_solid_angles(height)[..., None]).sum() / (4 * np.pi)
    cube = faces_from_cross(cross_from_panorama(light))[..., 0]
    assert np.isclose((cube * cube_solid_angles(height // 2)).sum() / (4 * np.pi), mean, rtol=1e-3)


@pytest.mark.feature("environment/equirect-to-cube")
def test_other_shapes_are_refused():
    with pytest.raises(ValueError):
        cross_from_panorama(np.zeros((4, 4, 3)))
    with pytest.raises(ValueError):
        faces_from_cross(np.zeros((8, 8, 3)))
