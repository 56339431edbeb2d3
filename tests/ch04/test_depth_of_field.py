"""Depth of field: discs as large as the lens makes them, no light lost, and nothing sharp that bleeds."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch04.post.lens import LARGEST_RADIUS, SENSOR_HEIGHT_M
from chapters.ch04.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.scenes import facing, quad_scene, texture, translated

pytestmark = pytest.mark.variants("vulkan", "gl")

SIDE = 96
SIZE = (SIDE, SIDE)
EXACT = Settings(
    color_format="rgba32f", gbuffer_format="full", graph="deferred", background=0.0, bokeh_taps=32
)
EYE = 4.0
CAMERA = View(pose_looking_at((0.0, 0.0, EYE), (0.0, 0.0, 0.0)), Perspective(2 * np.arctan(0.5), 0.1))
"""A length of z metres at z metres ahead is as large as the picture is high."""


def unlit(*color: float) -> Material:
    return Material(unlit=True, base_color=(*color, 1.0))


def bright(strength: float) -> Material:
    """Return a material that shines as strongly, and reflects nothing."""
    return Material(base_color=(0, 0, 0, 1), emissive=(strength,) * 3, metallic=1.0, roughness=1.0)


BLACK, WHITE, GREY = unlit(0, 0, 0), unlit(1, 1, 1), unlit(0.375, 0.375, 0.375)
STEPS = 2 * 2.0**-12 + 1e-6
"""Two steps of half precision at 0.375: blurred pictures are kept in halves twice, and some drivers cut digits off."""


def pixels(count: float, distance: float) -> float:
    """Return the length in metres that covers `count` pixels at a distance ahead of the camera."""
    return count * distance / SIDE


def place(x: float, y: float, distance: float, width: float, height: float) -> np.ndarray:
    """Return the matrix of a square from -width/2 to width/2 around (x, y), all in pixels, right and up."""
    matrix = translated(pixels(x, distance), pixels(y, distance), EYE - distance)
    matrix[0, 0], matrix[1, 1] = pixels(width / 2, distance), pixels(height / 2, distance)
    return matrix


def scene_of(*squares):
    """Return a scene of (material, matrix) pairs."""
    return quad_scene(
        materials=tuple(material for material, _ in squares),
        matrices=tuple(matrix for _, matrix in squares),
        instance_materials=tuple(range(len(squares))),
    )


def lens_for(radius: float, distance: float, focus: float) -> dict[str, float]:
    """Return the settings with which a point at `distance` gets a disc of this radius in pixels, by geometric optics.

    The picture is as high as it is far away, so the sensor is its height behind the lens; similar triangles then say
    that the disc is |1 - v/z'| = v |1/focus - 1/distance| of the opening, and the f-number is f / opening.
    """
    v = SENSOR_HEIGHT_M
    disc = 2 * radius / SIDE * SENSOR_HEIGHT_M
    opening = disc / (v * abs(1 / focus - 1 / distance))
    return {"aperture": 1 / (1 / v + 1 / focus) / opening, "focus_distance": focus}


def picture(chapter, scene, lens, view=CAMERA, size=SIZE):
    """Return the light of one frame through a lens (nothing: a pinhole), one channel of (H, W) float64 and the work."""
    settings = replaced(EXACT, **(lens or {}))
    with chapter.open(scene, size, settings, outputs={"color_linear"}) as renderer:
        frame = renderer.render(view)
        return frame.image("color_linear").astype(np.float64)[..., 0], frame.work


def test_a_constant_picture_stays_constant(chapter):
    """On a large square that is tilted from before the focus to far behind it, of one colour."""
    matrix = np.diag((80.0, 80.0, 80.0, 1.0)) @ rotation_about_x(0.9)
    scene = scene_of((GREY, matrix))
    got, _ = picture(chapter, scene, lens_for(5.0, 40.0, EYE))
    assert np.abs(got - 0.375).max() <= STEPS
    near, _ = picture(chapter, scene, lens_for(5.0, 2.0, EYE))
    assert np.abs(near - 0.375).max() <= STEPS


def rotation_about_x(angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[1:3, 1:3] = (np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))
    return matrix


@pytest.mark.parametrize("focus", [EYE, 0.0])
def test_what_is_in_focus_keeps_every_bit(chapter, focus):
    """By its distance, or, with none given, since it is in the middle of the picture."""
    noise = Image("noise", np.random.default_rng(1).integers(0, 256, (32, 32, 4), np.uint8))
    scene = quad_scene(
        Material(unlit=True, base_color_texture=texture()), matrices=(np.diag((9, 9, 1, 1)),), images=(noise,)
    )
    sharp, _ = picture(chapter, scene, None)
    got, work = picture(chapter, scene, {"aperture": 0.5, "focus_distance": focus})
    assert work["passes"] == 5
    assert sharp.std() > 0.1
    assert np.array_equal(got, sharp)


@pytest.mark.core
@pytest.mark.parametrize("distance", [8.0, 3.0])
def test_a_point_becomes_a_disc_of_the_right_size_and_loses_no_light(chapter, distance):
    """Behind the focus, where all is blurred alike, and before it, over what is sharp."""
    radius, strength = 5.0, 1000.0
    behind = distance > EYE
    ground = distance + 1e-3 if behind else EYE
    scene = scene_of(
        (BLACK, place(0, 0, ground, 400, 400)),
        (bright(strength), place(0, 0, distance, 2, 2)),
    )
    got, _ = picture(chapter, scene, lens_for(radius, distance, EYE))
    sharp, _ = picture(chapter, scene, None)
    assert sharp.sum() == 4 * strength
    assert got.sum() == pytest.approx(4 * strength, rel=0.02)
    x = np.arange(SIDE) + 0.5 - SIDE / 2
    squared = x[None, :] ** 2 + x[:, None] ** 2
    # The mean square distance in a disc of radius r whose rim fades over a pixel, in pixels of the half-size picture.
    # To that the square itself adds 2 * 2^2 / 12, halving the picture as much again, and enlarging it 2 * 2^2 / 6.
    r = radius / 2
    disc = (r**4 + r**2 / 2 + 1 / 80) / (2 * (r**2 + 1 / 12))
    assert (got * squared).sum() / got.sum() == pytest.approx(4 * disc + 2 / 3 + 2 / 3 + 4 / 3, rel=0.04)
    assert got[squared > (radius + 5.0) ** 2].max() < 1e-3 * got.max()


def covered(x: np.ndarray, radius: float) -> np.ndarray:
    """Return which part of discs around x lies at x < 0: a half plane, seen out of focus."""
    c = np.clip(x / radius, -1.0, 1.0)
    return (np.arccos(c) - c * np.sqrt(1.0 - c * c)) / np.pi


@pytest.mark.parametrize("distance", [8.0, 3.0])
def test_an_edge_fades_as_segments_of_a_disc(chapter, distance):
    """Left half white: of what is behind the focus, or of something before it that covers a sharp black ground."""
    radius = 5.0
    ground = distance if distance > EYE else EYE
    scene = scene_of(
        (BLACK, place(200, 0, ground, 400, 400) if distance > EYE else place(0, 0, ground, 400, 400)),
        (WHITE, place(-200, 0, distance, 400, 400)),
    )
    got, _ = picture(chapter, scene, lens_for(radius, distance, EYE))
    row = got[SIDE // 2]
    x = np.arange(SIDE) + 0.5 - SIDE / 2
    # Halved and enlarged, the picture is averaged over some two pixels; the segment's slope is at most 2 / (pi R).
    assert np.abs(row - covered(x, radius)).max() < 2 * 2 / (np.pi * radius) / 4
    assert np.abs(row[np.abs(x) > radius + 3] - (x < 0)[np.abs(x) > radius + 3]).max() < 0.01
    assert got.std(axis=0).max() < 1e-3, "all rows alike"


@pytest.mark.parametrize("colours", [(WHITE, BLACK), (BLACK, WHITE)])
def test_what_is_sharp_does_not_bleed_into_what_is_blurred_behind_it(chapter, colours):
    """An edge in focus before a blurred ground: on both sides of it every pixel is of one of the two colours."""
    front, ground = colours
    scene = scene_of(
        (ground, place(0, 0, 12.0, 4000, 4000)),
        (front, place(0.0, 0.0, EYE, 41, 41)),
    )
    sharp, _ = picture(chapter, scene, None)
    got, _ = picture(chapter, scene, lens_for(5.0, 12.0, EYE))
    assert {*np.unique(sharp)} == {0.0, 1.0}
    assert np.array_equal(got[sharp == (front is WHITE)], sharp[sharp == (front is WHITE)])
    assert np.abs(got - sharp).max() <= 1e-3


def test_what_is_less_blurred_hides_the_discs_of_what_lies_behind_it(chapter):
    """A black square, a little out of focus, before a bright ground with discs of 5 pixels: they stay outside.

    Something black before the focus lies over its edge, so that pixels around there look as far as its discs reach.
    """
    scene = scene_of(
        (WHITE, place(0, 0, 40.0, 9000, 9000)),
        (BLACK, place(0, 0, 4.8, 40, 40)),
        (BLACK, place(20, 0, 2.2, 10, 20)),
    )
    lens = lens_for(5.0, 40.0, EYE)
    blur = 5.0 * (1 / EYE - 1 / 4.8) / (1 / EYE - 1 / 40.0)
    assert 0.8 < blur < 1.2
    got, _ = picture(chapter, scene, lens)
    x = np.arange(SIDE) + 0.5 - SIDE / 2
    # As far as its own disc, and the two pixels over which the half-size picture averages. Behind what lies over the
    # edge something is guessed, and may be the ground's.
    inside = np.maximum(np.abs(x)[None, :], np.abs(x)[:, None]) < 20 - blur - 2
    guessed = (x > 15 - 2)[None, :] & (np.abs(x) < 10 + 2)[:, None]
    assert got[inside & ~guessed].max() < 0.02


def test_fewer_samples_than_pixels_cover_as_much(chapter):
    """An edge before the focus in a larger picture: 3 samples along a radius of 5 pixels of the half-size picture."""
    radius = 5.0
    scene = scene_of((BLACK, place(0, 0, EYE, 400, 400)), (WHITE, place(-200, 0, 3.0, 400, 400)))
    lens = lens_for(radius, 3.0, EYE) | {"bokeh_taps": 3}
    got, _ = picture(chapter, scene, lens, size=(2 * SIDE, SIDE * 2))
    x = (np.arange(2 * SIDE) + 0.5) / 2 - SIDE / 2
    assert np.abs(got[SIDE] - covered(x, radius)).max() < 0.15


def test_no_disc_is_larger_than_the_largest(chapter):
    """A point so near that its disc would fill the picture spreads over the largest one, with all its light."""
    scene = scene_of(
        (BLACK, place(0, 0, EYE, 400, 400)),
        (bright(1000.0), place(0, 0, 0.4, 2, 2)),
    )
    got, _ = picture(chapter, scene, {"aperture": 0.05, "focus_distance": EYE})
    lit = np.argwhere(got > 1e-3 * got.max())
    reach = np.abs(lit + 0.5 - SIDE / 2).max()
    assert reach <= LARGEST_RADIUS * SIDE + 4
    assert got.sum() == pytest.approx(4000.0, rel=0.03)


def test_fewer_samples_than_pixels_keep_the_light_of_a_smooth_picture(chapter):
    """The largest discs with 2 samples along a radius: a step is coarser, and a constant is still a constant."""
    matrix = np.diag((80.0, 80.0, 80.0, 1.0)) @ rotation_about_x(0.9)
    lens = lens_for(5.0, 40.0, EYE) | {"bokeh_taps": 2}
    got, _ = picture(chapter, scene_of((GREY, matrix)), lens)
    assert np.abs(got - 0.375).max() <= STEPS


def test_without_an_opening_nothing_of_it_is_there(chapter):
    scene = scene_of((WHITE, place(0, 0, EYE, 20, 20)))
    _, work = picture(chapter, scene, None)
    assert work["passes"] == 2
    _, work = picture(chapter, scene, {"aperture": 1.0})
    assert work["passes"] == 5
    _, work = picture(chapter, quad_scene(matrices=(), instance_materials=()), {"aperture": 1.0})
    assert work["passes"] == 2
    _, work = picture(chapter, scene, {"aperture": 1.0, "view": "normal"})
    assert work["passes"] == 1


def test_an_orthographic_view_and_an_odd_size_are_as_sharp_as_without_a_lens(chapter):
    scene = scene_of((WHITE, np.diag((0.5, 0.5, 1.0, 1.0))), (unlit(0.2, 0.2, 0.2), translated(0, 0, -5)))
    view = facing(3.0, 1.2)
    sharp, _ = picture(chapter, scene, None, view, (33, 17))
    got, _ = picture(chapter, scene, {"aperture": 0.1}, view, (33, 17))
    assert sharp.std() > 0.1
    assert np.array_equal(got, sharp)


def test_the_forward_path_has_the_same_lens_also_with_several_samples(chapter):
    scene = scene_of((WHITE, place(-200, 0, 8.0, 400, 400)), (BLACK, place(200, 0, 8.0, 400, 400)))
    lens = lens_for(4.0, 8.0, EYE)
    deferred, _ = picture(chapter, scene, lens)
    forward, _ = picture(chapter, scene, lens | {"graph": "forward"})
    assert np.allclose(forward, deferred, atol=1e-5)
    several, work = picture(chapter, scene, lens | {"graph": "forward", "msaa": 4})
    assert work["samples"] == 4
    assert np.abs(several - deferred).max() < 0.1
