"""Motion blur: nothing where nothing moves, and a straight ramp where a pan smears an edge."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch11.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Material
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.either import evaluate
from tests.support.glowing import glowing
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.shadows import PLAIN, point, yard

pytestmark = pytest.mark.variants("vulkan", "gl")

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""

WIDTH, HEIGHT = 96, 32
EDGE = 48
GLOWS = Settings(ambient=0.0, default_light=False, color_format="rgba32f", msaa=1, motion_blur_taps=64)


def panned(pixels):
    """Return the view after a pan to the right by so many pixels."""
    view = facing(ev100=EV)
    metres = 2.0 * pixels / HEIGHT
    return replace(view, world_from_view=pose_looking_at((metres, 0.0, 2.0), (metres, 0.0, 0.0)))


def smeared(chapter, pan, nits=1.0, **knobs):
    """Return the profile (W,) of a vertical edge after a pan, and where the edge is."""
    picture = np.zeros((HEIGHT, WIDTH), np.float32)
    picture[:, EDGE:] = nits
    with chapter.open(
        glowing(picture), (WIDTH, HEIGHT), replaced(GLOWS, **knobs), outputs={"color_linear"}
    ) as opened:
        opened.render(panned(0.0))
        found = opened.render(panned(pan)).image("color_linear").astype(np.float64)[..., 0] / nits
    return found, EDGE - pan


@pytest.mark.core
@pytest.mark.feature("postprocess/motion-blur")
@pytest.mark.parametrize(("pan", "shutter"), [(8, 1.0), (10, 0.5), (12, 2.0)])
def test_a_pan_smears_an_edge_into_the_ramp_of_a_box(chapter, pan, shutter):
    """Over shutter * pan pixels, with the edge in the middle: a box of that width over a step."""
    found, edge = smeared(chapter, pan, motion_blur=shutter)
    width = shutter * pan
    part = slice(edge - 20, edge + 20)
    assert np.abs(found[:, part] - found[:1, part]).max() < 1e-6
    profile = found[0, part]
    ramp = np.clip((np.arange(-20, 20) + 0.5) / width + 0.5, 0.0, 1.0)
    assert np.abs(profile - ramp).max() < 2e-3  # vectors are halves: 2^-11 of the way
    assert np.count_nonzero((profile > 1e-4) & (profile < 1 - 1e-4)) == pytest.approx(width, abs=1)


@pytest.mark.feature("postprocess/motion-blur")
def test_the_limit_holds_and_few_taps_are_noise_around_the_ramp(chapter):
    found, edge = smeared(chapter, 16, motion_blur=2.0, motion_blur_limit=10.0, motion_blur_taps=4)
    changed = (found[:, edge - 20 : edge + 20] > 1e-4) & (found[:, edge - 20 : edge + 20] < 1 - 1e-4)
    assert not changed[:, :14].any() and not changed[:, -14:].any() and changed.any()
    ramp = np.clip((np.arange(-20, 20) + 0.5) / 10.0 + 0.5, 0.0, 1.0)
    assert np.abs(found[:, edge - 20 : edge + 20].mean(0) - ramp).max() < 0.06
    assert np.ptp(found[:, edge]) > 0.2


@pytest.mark.feature("postprocess/motion-blur")
@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_an_unchanged_camera_returns_the_input_to_the_bit_and_a_changed_one_does_not(chapter, graph):
    """The first frame, the same view again, and one after a turn."""
    lens = Perspective(0.9, 0.05)
    view = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), lens)
    turned = View(pose_looking_at((3.0, 2.5, 4.0), (0.3, 0.4, 0.1)), lens)
    scene, pictures = yard(point((-1.2, 3.0, 0.8), candela=60.0)), []
    for shutter in (0.0, 1.0):
        knobs = replaced(Settings(**PLAIN), graph=graph, motion_blur=shutter, shadows="off", background=0.1)
        with chapter.open(scene, (64, 48), knobs) as opened:
            pictures.append([opened.render(it).image("color") for it in (view, view, turned, turned)])
            assert ("motion_blur" in [step.name for step in opened.graph.steps]) == (shutter > 0)
            assert ("motion" in [step.name for step in opened.graph.steps]) == (shutter > 0)
    same = [np.array_equal(one, other) for one, other in zip(*pictures, strict=True)]
    assert same == [True, True, False, True]


@pytest.mark.feature("postprocess/motion-blur")
def test_an_object_that_moves_is_smeared_within_and_what_stands_still_stays_to_the_bit(chapter):
    """A square with an edge in its middle moves by 6 pixels to the right before a background of noise."""
    rng = np.random.default_rng(7)
    noise = np.concatenate([rng.random((HEIGHT, WIDTH, 3)), np.ones((HEIGHT, WIDTH, 1))], -1)
    halves = np.ones((1, 2, 4), np.float32)
    halves[:, 0, :3] = 0.25
    shining = {"base_color": (0.0, 0.0, 0.0, 1.0), "metallic": 1.0, "roughness": 1.0, "emissive": (1.0,) * 3}
    matrices = np.diag([WIDTH / HEIGHT, 1.0, 1.0, 1.0]), np.diag([1.0, 0.5, 1.0, 1.0])
    matrices[1][:3, 3] = (-12.0 / HEIGHT, 0.0, 0.5)
    scene = quad_scene(
        materials=tuple(Material(**shining, emissive_texture=texture(number)) for number in (0, 1)),
        images=(Image("noise", noise.astype(np.float32)), Image("halves", halves)),
        matrices=matrices,
        instance_materials=(0, 1),
    )
    pictures = []
    for shutter in (0.0, 1.0):
        moving = copy.deepcopy(scene)
        with chapter.open(
            moving, (WIDTH, HEIGHT), replaced(GLOWS, motion_blur=shutter), outputs={"color_linear"}
        ) as opened:
            opened.render(panned(0.0))
            with moving.edit() as edit:
                edit.set_transform(1, matrix=translated(12.0 / HEIGHT) @ matrices[1])
            pictures.append(opened.render(panned(0.0)).image("color_linear").astype(np.float64))
    sharp, blurred = pictures
    rows, columns = slice(8, 24), slice(32, 64)
    outside = np.ones((HEIGHT, WIDTH), bool)
    outside[rows, columns] = False
    assert np.array_equal(sharp[outside], blurred[outside])
    ramp = np.clip((np.arange(-16, 16) + 0.5) / 6 + 0.5, 0.0, 1.0) * 0.75 + 0.25
    assert np.abs(blurred[rows, columns] - ramp[:, None]).max() < 2e-3


@pytest.mark.feature("postprocess/motion-blur")
def test_ways_are_scaled_and_limited_and_reach_half_their_length(either_device):
    rng = np.random.default_rng(6)
    motion = np.float32(rng.normal(size=(1000, 2)) * 10.0 ** rng.uniform(-6, 0, (1000, 1)))
    motion[:5] = 0.0
    away = np.float32(rng.uniform(0, 60, 1000))
    got = evaluate(
        either_device,
        ["motion_blur.glsl"],
        "way = smear_of(motion, vec2(640.0, 360.0), 0.5, 40.0); part = smear_reaches(length(way), away);",
        {"motion": motion, "away": away},
        {"way": "vec2", "part": "float"},
    )
    way = motion.astype(np.float64) * (320.0, 180.0)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    way *= np.minimum(1.0, 40.0 / np.maximum(length, 1e-30))
    np.testing.assert_allclose(got["way"], way, rtol=1e-5, atol=1e-12)
    part = np.clip(np.linalg.norm(way, axis=1) / 2 + 0.5 - away, 0, 1)
    assert np.abs(got["part"] - part).max() < 1e-5 and not got["way"][:5].any()
