"""Numerical stability of the picture: far from zero, very small, very large, with broken geometry and texels.

`chapter` is the one place that says which renderer is tested; later chapters hold the same bounds.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from assets import locate
from chapters.ch01.settings import Settings
from common.gltf import load_scene
from common.scene import Image, Light, Material
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene
from tests.support.scenes import (
    facing,
    moved,
    nodes_at,
    pixels_changed,
    quad_scene,
    scaled,
    texture,
    translated,
)

pytestmark = [pytest.mark.newest, pytest.mark.feature("tools/stability")]

SIZE = (128, 96)
BOUND = 1e-3
"""At most this fraction of pixels may change by more than 1/255: the bound that the whole project states."""

SUN = Light("directional", node=0, intensity=math.pi)


@pytest.fixture(scope="module")
def spheres():
    scene = load_scene(locate("spheres"))
    return scene, view_of_scene(scene, evaluate_pose(scene, 0.0), None, SIZE[0] / SIZE[1])


@pytest.fixture(scope="module")
def still(chapter, spheres):
    return picture(chapter, *spheres)


def picture(chapter, scene, view, output="color", settings=None, size=SIZE):
    with chapter.open(scene, size, settings, outputs={output}) as made:
        return made.render(view).image(output)


@pytest.mark.parametrize("offset", [(1e5, 0, 0), (0, 1e5, 0), (0, 0, 1e5), (-1e5, 1e5, 1e5)])
def test_a_world_moved_by_a_hundred_kilometres_looks_the_same(chapter, spheres, still, offset):
    """In float32 a position is 8 mm coarse out there; relative to the origin, which moves along, nothing changes."""
    assert pixels_changed(picture(chapter, *moved(*spheres, offset)), still) <= BOUND


@pytest.mark.parametrize("factor", [1e-3, 0.1, 10.0, 1e3])
def test_a_scaled_world_looks_the_same(chapter, spheres, still, factor):
    """Candelas grow with the square of length, lux and nits stay: the picture knows no unit of length."""
    settings = Settings()
    assert pixels_changed(picture(chapter, *scaled(*spheres, factor), settings=settings), still) <= BOUND


def test_the_stability_test_can_fail(chapter, spheres, still):
    """A camera that is off by a tenth of a pixel is seen by the measure that the tests above use."""
    scene, view = spheres
    pose = view.world_from_view.copy()
    pose[:3, 3] += pose[:3, 0] * 0.01 * scene.length_scale
    assert pixels_changed(picture(chapter, scene, replace(view, world_from_view=pose)), still) > 10 * BOUND


def extra_triangles(triangles, normal=(0.0, 0.0, 1.0)):
    """Return the square of `quad_scene` with further triangles (T, 3, 3) in its mesh."""
    scene = quad_scene(Material(metallic=0.0, roughness=0.5), lights=(SUN,))
    corners = np.array(triangles, np.float32).reshape(-1, 3)
    count = len(corners)
    scene.positions = np.concatenate([scene.positions, corners])
    scene.normals = np.concatenate([scene.normals, np.tile(np.float32(normal), (count, 1))])
    scene.tangents = np.concatenate([scene.tangents, np.tile(np.float32((1, 0, 0, 1)), (count, 1))])
    scene.uv0 = np.concatenate([scene.uv0, np.zeros((count, 2), np.float32)])
    scene.indices = np.concatenate([scene.indices, np.arange(4, 4 + count, dtype=np.uint32)])
    scene.meshes["index_count"], scene.meshes["vertex_count"] = 6 + count, 4 + count
    return scene


@pytest.mark.parametrize(
    ("name", "triangles", "normal"),
    [
        ("zero area, one point", [[(0, 0, 0.5)] * 3], (0, 0, 1)),
        ("zero area, one line", [[(-0.9, 0, 0.5), (0, 0, 0.5), (0.9, 0, 0.5)]], (0, 0, 1)),
        ("sliver", [[(-0.9, 0, -0.5), (0.9, 1e-7, -0.5), (0.9, -1e-7, -0.5)]], (0, 0, 1)),
        ("no normal, hidden", [[(-0.5, -0.5, -0.1), (0.5, -0.5, -0.1), (0, 0.5, -0.1)]], (0, 0, 0)),
        ("coincident with the square", [[(-1, -1, 0), (1, -1, 0), (1, 1, 0)]], (0, 0, 1)),
    ],
)
def test_degenerate_triangles_change_nothing(chapter, name, triangles, normal):
    view = facing()
    plain = picture(
        chapter, quad_scene(Material(metallic=0.0, roughness=0.5), lights=(SUN,)), view, "color_linear"
    )
    spoiled = picture(chapter, extra_triangles(triangles, normal), view, "color_linear")
    assert np.isfinite(spoiled).all()
    assert np.allclose(spoiled, plain, atol=1e-6), name


def test_a_surface_without_normals_stays_finite(chapter):
    scene = extra_triangles([[(-0.5, -0.5, 0.1), (0.5, -0.5, 0.1), (0, 0.5, 0.1)]], (0, 0, 0))
    assert np.isfinite(picture(chapter, scene, facing(), "color_linear")).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "role", ["base_color_texture", "emissive_texture", "metallic_roughness_texture", "normal_texture"]
)
def test_a_broken_texel_spoils_no_other_pixel(chapter, value, role):
    texels = np.full((16, 16, 4), 0.5, np.float32)
    material = replace(Material(emissive=(1, 1, 1), metallic=0.3, roughness=0.6), **{role: texture()})

    def shown(pixels):
        scene = quad_scene(material, lights=(SUN,), images=(Image("texels", pixels),))
        return picture(chapter, scene, facing(), "color_linear", size=(16, 16))

    whole = shown(texels)
    broken = texels.copy()
    broken[5, 7] = value
    spoiled = shown(broken)
    assert np.isfinite(spoiled).all()
    changed = (spoiled != whole).any(axis=-1)
    changed[5, 7] = False
    assert not changed.any()


@pytest.mark.parametrize("roughness", [0.0, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_the_ends_of_roughness_are_finite_even_in_the_highlight(chapter, roughness, metallic):
    """Light, normal and eye in one line: the peak of D at alpha = 0, where the formula has no value."""
    material = Material(roughness=roughness, metallic=metallic)
    light = Light("directional", node=0, intensity=1e6)
    linear = picture(chapter, quad_scene(material, lights=(light,)), facing(), "color_linear", size=(16, 16))
    assert np.isfinite(linear).all()
    assert (linear > 0).all()


def test_light_that_overflows_half_is_the_largest_colour(chapter):
    bright = Material(emissive=(1e30, 3e4, 1e38))
    view = facing()
    linear = picture(chapter, quad_scene(bright), view, "color_linear", size=(16, 16))
    from common.view.camera import exposure

    assert np.isfinite(linear).all()
    assert np.allclose(linear[..., 0] * exposure(view.ev100), 65504.0)
    shown = picture(chapter, quad_scene(bright), view, size=(16, 16))
    assert (shown > 200).all()


def test_a_light_on_the_surface_stays_finite(chapter):
    scene = quad_scene(Material(metallic=0.0), lights=(Light("point", node=0, intensity=1.0),))
    linear = picture(chapter, scene, facing(), "color_linear", size=(15, 15))
    assert np.isfinite(linear).all()


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag((0.0, 1.0, 1.0, 1.0)),
        np.diag((0.0, 0.0, 0.0, 1.0)),
        np.diag((1.0, 1.0, 0.0, 1.0)),
        np.diag((-1.0, 1.0, 1.0, 1.0)),
        np.diag((1e-20, 1e-20, 1e-20, 1.0)),
        np.diag((1.0, 1.0, 1e20, 1.0)),
    ],
    ids=["flat in x", "a point", "flat in z", "mirrored", "tiny", "huge in z"],
)
def test_singular_and_mirrored_transforms_are_finite_and_leave_the_rest_alone(chapter, matrix):
    material = Material(metallic=0.0, roughness=0.5)
    lights = (Light("directional", node=1, intensity=math.pi),)
    place = translated(-0.5) @ matrix @ np.diag((0.4, 0.4, 1.0, 1.0))
    other = translated(0.5) @ np.diag((0.4, 0.4, 1.0, 1.0))

    def shown(*matrices):
        scene = quad_scene(
            material, lights=lights, matrices=matrices, instance_materials=(0,) * len(matrices)
        )
        return picture(chapter, replace(scene, nodes=nodes_at(*matrices)), facing(), "color_linear")

    both = shown(place, other)
    hidden = shown(np.diag((0.0, 0.0, 0.0, 1.0)), other)
    assert np.isfinite(both).all()
    assert np.allclose(both[:, SIZE[0] // 2 :], hidden[:, SIZE[0] // 2 :], atol=1e-5)
