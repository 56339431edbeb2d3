"""The study one-light against Lambert's law in double precision, pixel by pixel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters import studies
from chapters.ch01.studies.one_light import Settings
from common.images.color import encode_srgb
from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Material
from common.scene.primitive import primitive_of, scene_of
from common.view.camera import Perspective, View
from tests.support.bounds import codes_off
from tests.support.scenes import facing, quad_scene

SIZE = (32, 32)
BASE = (0.9, 0.6, 0.25, 1.0)


def lamp_of(radius: float, time: float) -> tuple[np.ndarray, float]:
    """Return place and candela, from the README: two radii away, 45 degrees above, round once in 2 pi seconds."""
    angle = time
    place = 2 * radius * np.array([math.sin(angle), 1.0, math.cos(angle)]) / math.sqrt(2)
    return place, math.pi * radius**2


def codes(
    position: np.ndarray, normal: np.ndarray, radius: float, time: float, exposed: float = 1.0
) -> np.ndarray:
    """Return unrounded display codes (..., 3) of a matt surface of colour BASE."""
    place, candela = lamp_of(radius, time)
    to_lamp = place - position
    distance = np.linalg.norm(to_lamp, axis=-1)
    cosine = np.clip((to_lamp * normal).sum(axis=-1) / distance, 0, None)
    lux = candela * cosine / distance**2
    return 255 * encode_srgb(np.clip(np.array(BASE[:3]) / math.pi * lux[..., None] * exposed, 0, 1))


def centres(side: int) -> np.ndarray:
    """Return (side, side, 3) places on the square from -1 to 1 at pixel centres, row 0 on top."""
    axis = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(axis, -axis)
    return np.stack([x, y, 0 * x], axis=-1)


@pytest.mark.parametrize("time", [0.0, 0.8, math.pi, 5.0])
def test_a_flat_surface_has_the_light_of_angle_and_distance(stage, time):
    scene = quad_scene(Material(base_color=BASE))
    picture = stage.draw("one-light", SIZE, time, facing(1.0), scene=scene)["color"]
    expected = codes(centres(32), np.array([0.0, 0.0, 1.0]), math.sqrt(2), time)
    assert np.abs(picture - expected).max() <= codes_off(stage.device) + 0.05
    if time == math.pi:
        assert (picture == 0).all(), "the lamp is behind the square"


def test_exposure_and_brightness_are_factors_on_light(stage):
    scene = quad_scene(Material(base_color=BASE))
    view = facing(1.0)
    dim = View(view.world_from_view, view.projection, view.ev100 + 2.0)
    picture = stage.draw("one-light", SIZE, 0.0, dim, scene=scene, settings=Settings(brightness=0.5))["color"]
    expected = codes(centres(32), np.array([0.0, 0.0, 1.0]), math.sqrt(2), 0.0, exposed=0.5 / 4)
    assert np.abs(picture - expected).max() <= codes_off(stage.device) + 0.05


def sphere(rings: int, around: int):
    """Return a sphere of radius 1 as a scene: fine enough that its facets are within 1e-3 of it."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, around), indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    corner = np.arange(rings * around).reshape(rings, around)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1)
    flat = points.reshape(-1, 3)
    return scene_of("ball", flat, flat, np.zeros((len(flat), 2)), triangles, Material(base_color=BASE), [])


def test_a_sphere_is_lit_as_the_closed_form_of_a_sphere_says(stage):
    scene = sphere(96, 192)
    eye, yfov = np.array([1.0, 1.5, 4.0]), math.radians(32.0)
    view = View(pose_looking_at(eye, (0, 0, 0)), Perspective(yfov, 0.1))
    frame = stage.draw("one-light", SIZE, 1.0, view, scene=scene, outputs=("color", "depth"))
    axis = ((np.arange(32) + 0.5) / 32 * 2 - 1) * math.tan(yfov / 2)
    x, y = np.meshgrid(axis, -axis)
    ray = np.stack([x, y, np.full_like(x, -1.0)], axis=-1) @ view.world_from_view[:3, :3].T
    a, b, c = (ray**2).sum(-1), ray @ eye, eye @ eye - 1.0
    root = b * b - a * c
    hit = root > 0
    distance = (-b - np.sqrt(np.maximum(root, 0))) / a
    point = eye + ray * distance[..., None]
    assert np.abs((frame["depth"] > 0).sum() - hit.sum()) <= 4
    inner = hit & (np.sqrt(np.maximum(root, 0)) > 0.35 * np.sqrt(a))  # not at the rim, where facets show
    # The box around the sphere has half a diagonal of sqrt 3.
    expected = codes(point, point, math.sqrt(3), 1.0)
    assert inner.mean() > 0.3
    assert np.abs(frame["color"] - expected)[inner].max() <= codes_off(stage.device) + 0.6
    assert np.abs(frame["depth"] * distance / 0.1 - 1)[inner].max() < 2e-3


def test_the_lamp_goes_around_and_comes_back(stage):
    scene = studies.load("1/one-light", None)
    with stage.open("one-light", (24, 16), scene) as renderer:
        view = chapters.view_of(renderer)
        pictures = [renderer.render(view, time).image("color") for time in (0.0, 2.0, math.tau)]
    assert (pictures[0] == pictures[2]).all()
    assert (pictures[0] != pictures[1]).any()
    assert len(np.unique(pictures[0].reshape(-1, 3), axis=0)) > 20


def test_an_object_of_no_picture_is_as_bright_as_with_a_white_one(stage):
    """The texture that stands in for a missing one leaves everything as it is."""
    from common.scene import Image, TextureRef

    white = Image("white", np.full((2, 2, 4), 255, np.uint8))
    plain = quad_scene(Material(base_color=BASE))
    pictured = quad_scene(Material(base_color=BASE, base_color_texture=TextureRef(0)), images=(white,))
    a, b = (stage.draw("one-light", SIZE, 0.3, facing(1.0), scene=s)["color"] for s in (plain, pictured))
    assert (a == b).all()


def test_an_object_is_placed_with_its_normals_upright():
    """Rotated, stretched and mirrored: normals stay at right angles to the surface."""
    to_world = np.eye(4)
    to_world[:3, :3] = rotation((0.2, 1.0, 0.5), 0.8)[:3, :3] @ np.diag((3.0, -0.5, 1.0))
    to_world[:3, 3] = 5.0, -2.0, 1.0
    ball = sphere(9, 12)
    with ball.edit() as change:
        change.set_transform(0, matrix=to_world)
    moved = replace(ball)  # its bounds and its origin are found anew
    made = primitive_of(moved)
    assert (
        np.abs(made.positions + moved.origin - (ball.positions @ to_world[:3, :3].T + to_world[:3, 3])).max()
        < 1e-5
    )
    a, b, c = (made.positions[made.indices[corner::3]].astype(float) for corner in range(3))
    across = np.cross(b - a, c - a)
    sizes = np.linalg.norm(across, axis=1)
    faces = sizes > 1e-3
    mean = sum(made.normals[made.indices[corner::3]] for corner in range(3))[faces]
    cosine = (mean * across[faces]).sum(axis=1) / sizes[faces] / np.linalg.norm(mean, axis=1)
    # The mirror turns the winding around, not the normal.
    assert (cosine < -0.85).all()
    outward = made.positions + moved.origin - to_world[:3, 3]
    assert ((outward * made.normals).sum(axis=1) > 0).all()
    assert np.abs(np.linalg.norm(made.normals, axis=1) - 1).max() < 1e-6
