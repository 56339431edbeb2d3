"""Several samples a pixel and anisotropic filtering: coverage, the resolve, what they leave alone, and less error."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import chapters
from chapters import scenes
from chapters.ch01.frames.frame import OUTPUTS
from chapters.ch01.renderer import Renderer as Vulkan
from chapters.ch01.settings import Settings
from chapters.ch01.shading.samples import choose_samples
from common.environment import constant
from common.errors import UserError
from common.images.color import decode_srgb
from common.numerics.transforms import matrix_from_quaternion, pose_looking_at
from common.scene import Image, Material, Sampler, Scene
from common.settings import flat, preset, replaced
from common.view.camera import Perspective, View
from tests.support.chapter import on_opengl, on_path, targets_of
from tests.support.drivers import needs_feature, needs_whole_quads
from tests.support.scenes import facing, quad_scene, texture, translated
from tools.bench.points import _averaged

pytestmark = pytest.mark.variants("gl")

OpenGL = on_opengl(Vulkan)
SIZE = (32, 32)
FOUR = Settings(color_format="rgba32f", background=0.0, msaa=4)
LINEAR = replaced(FOUR, resolve="linear")
WHITE = Material(unlit=True)


@pytest.fixture(params=["vulkan", "gl"])
def opened(request, vulkan_device, gl_context):
    """What opens a renderer on one backend after the other."""
    kind, device = {"vulkan": (Vulkan, vulkan_device), "gl": (OpenGL, gl_context)}[request.param]
    return lambda scene, settings, size=SIZE, **more: kind(
        scene, size, on_path(settings), device=device, **more
    )


def offered_by(renderer: Any) -> set[int]:
    """Return the samples a pixel that the device has for what a renderer draws; from chapter 4 on its backend knows."""
    if hasattr(renderer, "_api"):
        found: set[int] = renderer._api.offered_samples(flat(renderer.settings)["color_format"])
        return found
    return set(renderer._offered())


def turned(degrees: float) -> np.ndarray:
    """Return the matrix of a large, turned square whose left edge goes through the middle."""
    angle = np.deg2rad(degrees)
    matrix = np.eye(4)
    matrix[:2, :2] = 8.0 * np.array([(np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))])
    matrix[:3, 3] = 8.0 * np.cos(angle), 8.0 * np.sin(angle), 0.0
    return matrix


def covered(matrix: np.ndarray, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return which part of each pixel the turned square covers, (H, W), from 64x64 points in each."""
    fine = 64
    x = (np.arange(size[0] * fine) + 0.5) / (size[0] * fine) * 2.0 - 1.0
    y = 1.0 - (np.arange(size[1] * fine) + 0.5) / (size[1] * fine) * 2.0
    in_square = np.linalg.inv(matrix)[0]
    inside = in_square[0] * x[None, :] + in_square[1] * y[:, None] + in_square[3] >= -1.0
    return inside.reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))


def shown_light(frame) -> np.ndarray:
    return decode_srgb(frame.image("color").astype(np.float32) / np.float32(255))


# --- coverage -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [10.0, 75.0])
def test_an_edge_has_one_level_more_than_samples_and_covers_what_it_should(opened, degrees):
    matrix = turned(degrees)
    with opened(quad_scene(WHITE, matrices=(matrix,)), LINEAR, outputs={"color_linear"}) as made:
        got = made.render(facing(ev100=np.log2(1 / 1.2))).image("color_linear")[..., 0].astype(np.float64)
        assert made.samples == 4
    truth = covered(matrix)
    edge = (truth > 0) & (truth < 1)
    assert edge.sum() > 30
    assert np.allclose(np.unique(got), np.arange(5) / 4, atol=1e-6)
    assert (got[~edge] == np.round(truth[~edge])).all()
    assert abs(got[edge].mean() - truth[edge].mean()) < 0.02 < 1 / 8
    assert np.abs(got - truth)[edge].mean() <= 1 / 8  # one sample a pixel: about 1/4


@pytest.mark.parametrize("offset", [0.1, 0.3, 0.5, 0.8])
def test_an_alpha_mask_covers_as_many_samples_as_it_fills_of_the_pixel(opened, vulkan_device, offset):
    """Alpha is a ramp over 8 pixels, and 0.5 is crossed `offset` pixels inside of one."""
    needs_whole_quads(vulkan_device)
    alpha = np.float32((0, 1, 1, 0))
    colors = np.ones((4, 4), np.float32)
    colors[:, 3] = alpha
    matrix = np.eye(4)
    matrix[:, 0] *= 8 / 32
    matrix[0, 3] = offset * 2 / 32
    scene = quad_scene(Material(unlit=True, alpha_mode="mask"), matrices=(matrix,), colors=colors)
    with opened(scene, LINEAR, outputs={"color_linear"}) as made:
        row = made.render(facing(ev100=np.log2(1 / 1.2))).image("color_linear")[16, 12:20, 0]
    truth = np.float64([0, 0, 0, 0, 1 - offset, 1, 1, 1])
    assert np.abs(row - truth).max() <= 1 / 8 + 1e-4
    assert np.allclose(row * 4, np.round(row * 4), atol=1e-5)
    with opened(scene, replaced(LINEAR, mask_coverage=False), outputs={"color_linear"}) as made:
        row = made.render(facing(ev100=np.log2(1 / 1.2))).image("color_linear")[16, 12:20, 0]
    assert np.allclose(row, np.round(row), atol=1e-6)


# --- the resolve ----------------------------------------------------------------------------------------------------

BEND = 0.76


def tone(peak: np.ndarray) -> np.ndarray:
    bright = np.maximum(peak, BEND)
    return np.where(peak <= BEND, peak, 1.0 - (1.0 - BEND) ** 2 / (bright + 1.0 - 2.0 * BEND))


def tone_inverse(shown: np.ndarray) -> np.ndarray:
    bright = np.maximum(shown, BEND)
    return np.where(shown <= BEND, shown, (1.0 - BEND) ** 2 / (1.0 - bright) - 1.0 + 2.0 * BEND)


def weighted(front: np.ndarray, back: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return what the tone-weighted resolve is in float64, of pixels (N,) with `part` of the samples in front."""
    as_shown = [
        color * (tone(color.max()) / color.max() if color.max() > 0 else 1.0) for color in (front, back)
    ]
    mean = part[:, None] * as_shown[0] + (1.0 - part[:, None]) * as_shown[1]
    peak = mean.max(axis=-1, keepdims=True)
    return mean * np.where(peak > 0, tone_inverse(peak) / np.maximum(peak, 1e-30), 1.0)


COLORS = [
    ((0.7, 0.1, 0.02), (0.1, 0.2, 0.3)),
    ((0.9, 0.8, 0.7), (0.0, 0.0, 0.0)),
    ((100.0, 20.0, 5.0), (0.01, 0.02, 0.03)),
    ((50.0, 0.0, 0.0), (0.0, 3.0, 0.0)),
    ((60000.0, 60000.0, 100.0), (0.0, 0.0, 0.0)),
    ((2000.0, 2000.0, 2000.0), (1999.0, 2000.0, 2001.0)),
]


def test_the_resolve_is_the_mean_of_what_is_shown(opened):
    """Against a twin in double precision; and below the curve's bend it is the mean of light to the bit."""
    matrices = (translated(0.0, 0.0, -0.5) @ np.diag([8.0, 8.0, 1.0, 1.0]), turned(10.0))
    plain = (Material(unlit=True, base_color=(0, 0, 0, 1)), Material(unlit=True, base_color=(1, 1, 1, 1)))
    scene = quad_scene(materials=plain, matrices=matrices, instance_materials=(0, 1))
    found = {}
    for settings in (LINEAR, FOUR):
        with opened(scene, settings, outputs={"color_linear"}) as made:
            for number, (front, back) in enumerate([((1, 1, 1), (0, 0, 0)), *COLORS]):
                with scene.edit() as edit:
                    edit.set_material(0, Material(unlit=True, base_color=(*back, 1)))
                    edit.set_material(1, Material(unlit=True, base_color=(*front, 1)))
                view = facing(ev100=np.log2(1 / 1.2))  # an exposure of 1
                found[settings.post.resolve, number] = made.render(view).image("color_linear").reshape(-1, 3)
    part = np.round(found["linear", 0][:, 0].astype(np.float64) * 4) / 4
    assert set(part) == {0, 0.25, 0.5, 0.75, 1}
    for number, (front, back) in enumerate(COLORS, start=1):
        a, b = np.float64(front), np.float64(back)
        light = part[:, None] * a + (1 - part[:, None]) * b
        assert np.allclose(found["linear", number], light, rtol=1e-6)
        assert np.allclose(found["tone-weighted", number], weighted(a, b, part), rtol=2e-6, atol=1e-6), front
    assert np.array_equal(found["linear", 1], found["tone-weighted", 1])


def test_the_edge_of_a_bright_lamp_is_shown_in_levels(opened):
    """A quarter of a lamp is shown as a quarter of its light; the mean of light would show all of it."""
    scene = quad_scene(Material(unlit=True, base_color=(100, 100, 100, 1)), matrices=(turned(10.0),))
    levels = {}
    for settings in (FOUR, LINEAR):
        with opened(scene, settings, outputs={"color", "color_linear"}) as made:
            frame = made.render(facing())
            shown, light = shown_light(frame)[..., 0], frame.image("color_linear")[..., 0]
        order = np.unique(light)
        levels[settings.post.resolve] = [float(shown[light == one].mean()) for one in order if one > 0]
    assert len(levels["tone-weighted"]) == len(levels["linear"]) == 4
    assert np.allclose(levels["tone-weighted"], (0.25, 0.5, 0.75, 1.0), atol=0.06)
    assert min(levels["linear"]) > 0.95


# --- what several samples leave alone ---------------------------------------------------------------------------------


def crossing() -> Scene:
    """Return squares that cross each other, one with an alpha mask, a transparent one in front, and a sky."""
    tilted = np.eye(4)
    tilted[:3, :3] = matrix_from_quaternion((0.25, 0.3, 0.1, 0.9))[:3, :3]
    colors = np.ones((4, 4), np.float32)
    colors[:, 3] = 0, 1, 1, 0
    scene = quad_scene(
        materials=(WHITE, Material(unlit=True, alpha_mode="mask"), Material(unlit=True, alpha_mode="blend")),
        matrices=(turned(10.0), tilted, tilted.T, translated(0.3, 0.2, 1.0)),
        instance_materials=(0, 0, 1, 2),
        colors=colors,
    )
    scene.environment = constant((0.1, 0.2, 0.4))
    return scene


SMALL = {"environment_size": 16, "irradiance_source": 16, "table_size": 16, "table_samples": 16}


@pytest.mark.parametrize("name", ["crossing", "cornell"])
def test_depth_and_ids_are_those_of_the_centre_however_many_samples(opened, name):
    scene = crossing() if name == "crossing" else scenes.load(name)
    view = facing() if name == "crossing" else None
    found = []
    for msaa in (1, 4):
        with opened(scene, Settings(msaa=msaa, **SMALL), (64, 48), outputs=OUTPUTS) as made:
            view = view or chapters.view_of(made)
            frame = made.render(view)
            found.append((frame.image("depth"), frame.image("instance_id"), frame.image("color_linear")))
    assert np.array_equal(found[0][0], found[1][0]) and np.array_equal(found[0][1], found[1][1])
    assert len(np.unique(found[0][1])) > 3
    corner = found[1][2][-1, 0]  # of the sky, where there is one
    assert np.array_equal(corner, found[0][2][-1, 0]) and (name == "cornell" or corner[2] > 2 * corner[0] > 0)
    with opened(scene, Settings(msaa=4, **SMALL), (64, 48), outputs={"depth"}) as made:
        assert np.array_equal(made.render(view).image("depth"), found[0][0])


def test_one_sample_costs_nothing_of_it(opened):
    """No pass, target, pipeline or set more than without the setting; and with four, exactly what they need."""
    work = {}
    scene = quad_scene(WHITE)
    for msaa in (1, 4):
        with opened(scene, replaced(FOUR, msaa=msaa)) as made:
            work[msaa] = made.render(facing()).work
            names, targets = [one.name for one in made.passes], targets_of(made)
        if msaa == 1:
            assert (names, targets) == (["forward", "tonemap"], {"color_hdr", "depth", "color"})
        else:
            assert names == ["forward", "resolve", "tonemap"]
            assert targets == {"color_msaa", "depth_msaa", "color_hdr", "color"}
    uncounted = ("descriptor_sets", "barriers", "transitions", "transient_bytes", "transient_bytes_alone")
    more = {key: work[4][key] - work[1][key] for key in work[1] if key not in uncounted}
    changed = {key: value for key, value in more.items() if value}
    calls = {"draw_calls": 1} if "draw_calls" in work[1] else {}  # where one may draw many objects
    assert changed == calls | {
        "draws": 1,
        "triangles": 1,
        "pipeline_binds": 1,
        "descriptor_binds": 1,
        "passes": 1,
        "passes_skipped": -1,
        "pipelines": 1,
        "samples": 3,
    }


def test_a_resize_keeps_the_samples_and_an_empty_scene_its_outputs(opened):
    scene = quad_scene(WHITE, matrices=(turned(10.0),))
    with opened(scene, FOUR, outputs=OUTPUTS) as made, opened(scene, FOUR, (20, 12), outputs=OUTPUTS) as new:
        made.render(facing())
        made.resize((20, 12))
        a, b = made.render(facing()), new.render(facing())
        assert all(np.array_equal(a.image(name), b.image(name)) for name in OUTPUTS)
    with opened(quad_scene(matrices=()), FOUR, outputs=OUTPUTS) as made:
        frame = made.render(facing())
        assert (frame.image("depth") == 0).all() and frame.image("depth").dtype == np.float32
        assert (frame.image("instance_id") == 0).all()


# --- how many -------------------------------------------------------------------------------------------------------


def test_a_number_that_the_device_lacks_is_refused_with_those_it_has(opened):
    with opened(quad_scene(WHITE), Settings()) as made:
        missing = {1, 2, 4, 8, 3} - offered_by(made)
        assert {1, 4} <= offered_by(made)
    for number in missing:
        with pytest.raises(UserError, match=rf"with 1.* or \d+ samples a pixel, not with {number}: set msaa"):
            opened(quad_scene(WHITE), Settings(msaa=number))


def test_a_preset_takes_what_the_device_has(opened):
    wish = replaced(preset(Settings, "reference"), ambient=1.0)
    for offered, expected in (({1}, 1), ({1, 4}, 4), ({16, 4, 2, 1}, 4), ({1, 2, 4, 8}, 8)):
        samples, short = choose_samples(wish, offered, "Toaster")
        assert (samples, bool(short)) == (expected, expected < 8)
    with pytest.raises(
        UserError, match="Toaster draws rgba16f pictures with 1, 2 or 4 samples a pixel, not with 8"
    ):
        choose_samples(Settings(msaa=8), {4, 2, 1}, "Toaster")
    with opened(quad_scene(WHITE), wish) as made:
        assert made.settings == on_path(wish)  # the panel still shows the preset
        assert made.samples == made.render(facing()).work["samples"] == max(offered_by(made) & {1, 2, 4, 8})
        short = [one.path for one in made.plan.choices if one.feature == "msaa"]
        assert short == ([] if made.samples == 8 else [f"{made.samples} samples a pixel"])


# --- against many samples ---------------------------------------------------------------------------------------------


def error(made_picture: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((made_picture.astype(np.float64) - truth) ** 2)))


@pytest.mark.parametrize("name", ["cornell", "spheres"])
def test_more_samples_are_less_error(opened, name):
    """Against 4x4 times as many pixels, averaged as the light that is shown."""
    scene, size = scenes.load(name), (64, 36)
    best = Settings(color_format="rgba32f", anisotropy=16.0)
    with opened(scene, best, (4 * size[0], 4 * size[1])) as made:
        view = chapters.view_of(made)
        truth = _averaged(shown_light(made.render(view)), 4)
        offered = sorted(offered_by(made) & {1, 2, 4, 8})
    errors = []
    for msaa in offered:
        with opened(scene, replaced(best, msaa=msaa), size) as made:
            errors.append(error(shown_light(made.render(view)), truth))
    # The truth has 16 samples a pixel itself: from four on, what is left is as much its error (8 on an H200: as 4).
    up_to_four = errors[: offered.index(4) + 1]
    assert all(more < 0.9 * fewer for fewer, more in pairwise(up_to_four)), errors
    assert all(more < 1.05 * fewer for fewer, more in pairwise(errors)), errors
    assert up_to_four[-1] < 0.7 * errors[0], errors


@pytest.mark.feature("textures/anisotropic-filtering")
def test_anisotropic_filtering_comes_nearer_to_many_samples_and_keeps_more_contrast(
    opened, vulkan_device, gl_context
):
    """A grating on a floor at a grazing angle: lines run away from the viewer, and a trilinear filter blurs them."""
    for device in (vulkan_device, gl_context):
        needs_feature(device, "anisotropy")
    stripes = np.zeros((64, 64, 4), np.uint8)
    stripes[..., 3] = 255
    stripes[:, ::2, :3] = 255
    stripes = np.repeat(np.repeat(stripes, 4, axis=0), 4, axis=1)
    trilinear = Sampler("linear", "linear", "linear", "repeat", "repeat")
    material = Material(unlit=True, base_color_texture=texture(0, trilinear))
    floor = quad_scene(material, images=(Image("grating", stripes),), uv_scale=1.0)
    pose = pose_looking_at((0.0, -1.05, 0.1), (0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0))
    view, size = View(pose, Perspective(np.deg2rad(40.0), 0.01), ev100=0.0), (64, 32)
    base = Settings(color_format="rgba32f", tone_curve="none")

    def drawn(settings, factor=1, **more):
        scaled = (size[0] * factor, size[1] * factor)
        with opened(floor, settings, scaled, outputs={"color_linear"}, **more) as made:
            return made.render(view).image("color_linear")[..., 0]

    truth = _averaged(drawn(replaced(base, anisotropy=16.0), 8)[..., None], 8)[..., 0]
    levels = [drawn(replaced(base, anisotropy=level)) for level in (1.0, 2.0, 4.0, 16.0)]
    errors = [error(one[14:], truth[14:]) for one in levels]
    contrasts = [float(one[14:].std(axis=1).mean()) for one in levels]
    assert all(more < fewer for fewer, more in pairwise(errors)), errors
    assert all(more > fewer for fewer, more in pairwise(contrasts)), contrasts
    assert np.array_equal(levels[0], drawn(replaced(base, anisotropy=16.0), without={"anisotropy"}))
