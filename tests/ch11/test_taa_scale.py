"""Pictures with more pixels than are drawn: sizes, what a still view becomes, figures, and what is refused."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters import scenes
from chapters.ch11.settings import Settings
from chapters.ch11.taa import jitter, model, scale
from common.errors import UserError
from common.images.color import encode_srgb
from common.reports.metrics import flip_mean
from common.settings import apply_overrides, replaced
from common.view.camera import exposure
from tests.support.taa import FULL, PERIOD, SIZE, STEP, VIEW, court, frames_of, light, opened
from tests.twins import upscale as twin
from tests.twins.shading import tone_neutral

pytestmark = pytest.mark.variants("vulkan", "gl")

UNIT = 2.0**-24
SCALE = 0.67
BASE = Settings(**{**FULL, "taa_scale": SCALE})
DRAWN = (27, 20)
"""SIZE times SCALE, rounded: 26.8 and 20.1."""

COUNT = 36
"""Frames of a period: the least number with 16 samples of each pixel."""

OUTPUTS = ("color", "color_linear", "depth", "instance_id", "motion")


@pytest.fixture(scope="module")
def scene():
    return court()


def test_passes_before_the_history_draw_fewer_pixels_and_those_behind_it_all(chapter, scene):
    more = {"bloom": 0.2, "aperture": 2.8, "motion_blur": 0.5, "alias": False}
    with opened(chapter, BASE, scene, *OUTPUTS, **more) as renderer:
        frame = renderer.render(VIEW)
        sizes = {node.name: renderer.graph.resources[renderer.graph.names[node.writes[0].resource]].size
                 for node in renderer.nodes}  # fmt: skip
        halves = (SIZE[0] // 2, SIZE[1] // 2)
        assert {name: sizes[name] for name in ("forward", "motion")} == {"forward": DRAWN, "motion": DRAWN}
        for name in (
            "taa",
            "depth_of_field",
            "bloom",
            "motion_blur",
            "tonemap",
            "instance_id",
            "enlarge_depth",
        ):
            assert sizes[name] == SIZE, name
        assert sizes["bloom_down_1"] == sizes["bokeh"] == halves
        for name in OUTPUTS:
            assert frame.image(name).shape[1::-1] == SIZE, name
        renderer.resize((33, 21))
        frame = renderer.render(VIEW)
        assert frame.reset == "resize"
        for name in OUTPUTS:
            assert frame.image(name).shape[1::-1] == (33, 21), name


@pytest.mark.parametrize(
    ("size", "part", "drawn"),
    [((1, 1), 0.5, (1, 1)), ((5, 2), 0.5, (2, 1)), ((320, 180), 0.67, (214, 121)), ((7, 3), 1.0, (7, 3))],
)
def test_sides_are_rounded_and_never_empty(size, part, drawn):
    assert scale.drawn_size(Settings(taa="full", taa_scale=part), size) == drawn


@pytest.mark.parametrize(("part", "count"), [(1.0, 4), (0.99, 17), (0.67, 36), (0.5, 64)])
def test_a_period_has_sixteen_samples_of_each_pixel(part, count):
    assert scale.period(Settings(taa="full", taa_scale=part, jitter_period=4)) == count
    assert scale.period(Settings(taa="full", taa_scale=part, jitter_period=64)) == 64


def test_textures_are_looked_up_as_at_the_size_of_the_picture():
    knobs = {"taa": "full", "mip_bias": -0.25, "taa_scale": 0.5}
    assert dict(model.texture_defines(Settings(**knobs)))["MIP_BIAS"] == -1.25
    assert "MIP_BIAS" not in dict(model.texture_defines(Settings(**{**knobs, "taa": "off"})))


# --- what a picture converges to ---


def test_a_view_that_stands_still_becomes_the_mean_of_all_samples_and_rests(chapter, scene):
    """Against float64, from the images that were drawn.

    A frame's mean and each step of the history round by some units, a jitter in float32 by one of the picture's size
    in pixels. The kernel's slope is at most 2 for a pixel, so weights of float32 are off by 2 * 40 units, and colours
    by that part of the largest.
    """
    rest = model.REST_PERIODS * COUNT
    shifts = jitter.offsets("halton", COUNT)
    with chapter.open(scene, SIZE, BASE, outputs={"color_linear"}, inspect=True) as renderer:
        found, sums = [], []
        for n in range(COUNT):
            frame = renderer.render(VIEW)
            drawn = frame.image("forward/color_hdr")[..., :3].astype(np.float64)
            assert drawn.shape[1::-1] == DRAWN
            sums.append(twin.sums(drawn, tuple(shifts[n]), SIZE, model.KERNEL_RADIUS))
            found.append(frame.image("taa/history_color")[..., :3].astype(np.float64))
        most = max(picture.max() for picture in found)
        for n in (0, 1, COUNT - 1):
            bound = (2 * 2 * max(SIZE) + 4 * (n + 2)) * UNIT * most
            assert np.abs(found[n] - twin.mean(sums[: n + 1])).max() <= bound, n
        while not renderer.idle(VIEW):
            frame = renderer.render(VIEW)
            n += 1
        assert n + 1 == rest == frame.work["taa_frames"]
        last = frame.image("taa/history_color")
        assert np.abs(last[..., :3] - twin.mean(sums)).max() <= (4 * max(SIZE) + 4 * rest) * UNIT * most
        for _ in range(2):
            assert np.array_equal(renderer.render(VIEW).image("taa/history_color"), last)
    assert np.abs(twin.mean(sums) - twin.mean(sums[:1])).max() > 0.05 * most


def test_a_picture_that_rests_is_nearer_to_many_samples_than_one_frame(chapter, scene):
    """The truth has 8x8 samples a pixel."""
    with opened(
        chapter, replaced(BASE, taa="off", taa_scale=1.0), scene, size=(8 * SIZE[0], 8 * SIZE[1])
    ) as renderer:
        many = light(renderer.render(VIEW)).reshape(SIZE[1], 8, SIZE[0], 8, 3).mean(axis=(1, 3))
    with opened(chapter, BASE, scene) as renderer:
        first, *_, last = frames_of(renderer, 2 * COUNT)
    with opened(chapter, replaced(BASE, taa="off", taa_scale=1.0), scene) as renderer:
        whole = light(renderer.render(VIEW))
    errors = [np.sqrt(np.mean((picture - many) ** 2)) for picture in (first, whole, last)]
    assert errors[2] < 0.5 * errors[1] and errors[2] < 0.4 * errors[0], errors


def test_a_view_that_has_moved_rests_close_to_its_mean(chapter, scene):
    with opened(chapter, BASE, scene) as renderer:
        alone = frames_of(renderer, COUNT, VIEW)[-1]
        frames_of(renderer, 3, STEP)
        count = 0
        while not renderer.idle(VIEW):
            frame = renderer.render(VIEW)
            count += 1
        assert count == (model.REST_PERIODS + 1 + model.short_means(COUNT)) * COUNT
        found = light(frame)
        assert np.array_equal(light(renderer.render(VIEW)), found)
    assert np.abs(found - alone).max() < 2 * model.RESIDUE * alone.max()


def test_first_frames_cuts_and_sizes_have_no_history(chapter, scene):
    with opened(chapter, BASE, scene) as renderer:
        first = light(renderer.render(VIEW))
        for again in (
            lambda: renderer.render(replace(VIEW, cut=True), 0.5),
            lambda: (renderer.reset_history("test"), renderer.render(VIEW, 0.5))[1],
            lambda: (renderer.resize((20, 16)), renderer.resize(SIZE), renderer.render(VIEW, 0.5))[2],
        ):
            frame = again()
            assert np.array_equal(light(frame), first), frame.reset
            frames_of(renderer, 2, STEP)


@pytest.mark.parametrize("msaa", [1, 4])
def test_ids_depth_and_motion_have_the_picture_in_their_places(chapter, scene, msaa):
    settings = replaced(BASE, msaa=msaa)
    with opened(chapter, settings, scene, "instance_id", "depth", taa="off", taa_scale=1.0) as renderer:
        frame = renderer.render(VIEW)
        ids, depth = frame.image("instance_id"), frame.image("depth")
    with opened(chapter, settings, scene, "instance_id", "depth", "motion") as renderer:
        for _ in range(3):
            frame = renderer.render(VIEW)
            assert np.array_equal(frame.image("instance_id"), ids)
            assert not frame.image("motion").any()
            assert np.mean((frame.image("depth") > 0) == (depth > 0)) > 0.97
        moved = renderer.render(STEP).image("motion")
    with opened(chapter, settings, scene, "motion", taa_scale=1.0) as renderer:
        renderer.render(VIEW)
        whole = renderer.render(STEP).image("motion")
    assert np.median(np.abs(moved - whole)) < 0.05 * np.abs(whole).max()


# --- with other subjects, and without ---


@pytest.mark.parametrize(
    "more",
    [
        {"taa": "simple", "taa_scale": 0.5},
        {
            "taa_velocity": "longest",
            "taa_history": "bilinear",
            "taa_weight": "luminance",
            "taa_format": "rgba16f",
        },
        {"msaa": 4, "taa_tolerance": 0.0, "taa_reactive": 0.0, "exposure": "histogram"},
        {"graph": "compute", "rate_policy": "radial"},
        {"graph": "deferred", "ssao": "shader", "fog": "on", "fog_half": True, "surfaces": "visibility"},
    ],
    ids=lambda more: "-".join(map(str, more.values())),
)
def test_each_mode_is_finite_and_near_the_whole_picture(chapter, scene, more):
    settings = replaced(BASE, **more)
    with opened(chapter, settings, scene, "depth", "instance_id", "motion") as renderer:
        *_, found = [light(renderer.render(view)) for view in (STEP, VIEW, VIEW, VIEW)]
        assert renderer.idle(VIEW) is False
    with opened(chapter, replaced(settings, taa_scale=1.0), scene) as renderer:
        *_, whole = [light(renderer.render(view)) for view in (STEP, VIEW, VIEW, VIEW)]
    assert np.isfinite(found).all()
    assert abs(found.mean() - whole.mean()) < 0.03 * whole.mean()
    assert np.median(np.abs(found - whole)) < 0.05 * whole.mean()


def test_what_compares_pixels_is_refused(chapter, scene):
    for more, words in (
        ({"taa": "off"}, "taa=full"),
        ({"taa_filter": "tent"}, "taa_filter=tent has no effect"),
        ({"rate_policy": "sobel"}, "rate_policy=sobel"),
        ({"rate_policy": "radial", "rate_tint": True}, "rate_tint"),
    ):
        with pytest.raises(UserError, match=words):
            opened(chapter, replaced(BASE, **more), scene)


def test_without_the_pass_that_fills_the_picture_there_is_none(chapter, scene):
    with opened(chapter, BASE, scene) as renderer:
        first = light(renderer.render(VIEW))
        with pytest.raises(UserError, match=r"taa_scale=0\.67"):
            renderer.switch_pass("taa", False)
        renderer.reset_history("test")
        assert np.array_equal(light(renderer.render(VIEW)), first)


def test_at_the_size_of_the_picture_nothing_is_made(chapter, scene):
    with opened(chapter, BASE, scene, *OUTPUTS, taa_scale=1.0) as renderer:
        renderer.render(VIEW)
        names = {gpu_pass.name for gpu_pass in renderer.passes}
        assert not [name for name in names if name.startswith(scale.ENLARGE)]
        assert "history_weight" not in renderer.graph.resources
        assert {"depth", "history_color"} <= renderer.graph.names.keys()
        assert renderer.techniques["taa"]._period == PERIOD


@pytest.mark.parametrize("value", ["0.49", "1.01", "nan"])
def test_other_scales_are_refused(value):
    with pytest.raises(UserError, match="taa_scale"):
        apply_overrides(Settings(), [f"taa_scale={value}"])


# --- figures ---


def turned(view, angle):
    pose, around = view.world_from_view.copy(), np.eye(3)
    around[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    pose[:3, :3] = pose[:3, :3] @ around
    return replace(view, world_from_view=pose)


def coded(frame_light, view):
    return np.float32(
        encode_srgb(tone_neutral(np.maximum(frame_light, 0.0) * exposure(view.ev100)).clip(0, 1))
    )


@pytest.mark.long
@pytest.mark.needs("flip_evaluator")
@pytest.mark.variants("gl")
def test_two_thirds_look_nearly_like_the_whole_picture(chapter):
    """FLIP against 8x8 samples a pixel, of the atrium at rest and after 16 frames of a pan by a pixel each."""
    size, step, count = (160, 90), 0.006, 16
    scene = scenes.load("atrium")
    base = Settings(taa="full")
    with chapter.open(
        scene, (8 * size[0], 8 * size[1]), replaced(base, taa="off"), outputs={"color_linear"}
    ) as renderer:
        renderer.wait_loaded()
        view = chapters.view_of(renderer)
        last = turned(view, step * (count - 1))
        many = [
            coded(light(renderer.render(each)).reshape(size[1], 8, size[0], 8, 3).mean(axis=(1, 3)), view)
            for each in (view, last)
        ]
    errors = []
    for part in (1.0, SCALE):
        with opened(chapter, base, scene, size=size, taa_scale=part) as renderer:
            renderer.wait_loaded()
            frame = renderer.render(view)
            while not renderer.idle(view):
                frame = renderer.render(view)
            rested = coded(light(frame), view)
            renderer.reset_history("pan")
            for n in range(count):
                frame = renderer.render(turned(view, step * n))
            errors.append(
                [
                    flip_mean(found, truth)
                    for found, truth in zip((rested, coded(light(frame), view)), many, strict=True)
                ]
            )
    assert errors[1][0] <= 1.15 * errors[0][0] and errors[1][1] <= 1.5 * errors[0][1], errors


@pytest.mark.long
@pytest.mark.variants("gl")
def test_two_thirds_take_two_thirds_of_the_time_where_shading_dominates(chapter):
    """Whole frames of both renderers in turn, so that what else runs on the machine slows both."""
    scene, base = scenes.load("atrium"), Settings(taa="full", taa_average=False, shadow_kernel=13)
    spent = {1.0: [], SCALE: []}
    with (
        opened(chapter, base, scene, size=(480, 270)) as whole,
        opened(chapter, base, scene, size=(480, 270), taa_scale=SCALE) as part,
    ):
        for renderer in (whole, part):
            renderer.wait_loaded()
        view = chapters.view_of(whole)
        for n in range(7):
            for scale_, renderer in ((1.0, whole), (SCALE, part)):
                began = time.process_time()
                renderer.render(turned(view, 0.002 * n)).image("color_linear")
                spent[scale_].append(time.process_time() - began)
    assert np.median(spent[1.0][3:]) >= 1.5 * np.median(spent[SCALE][3:]), spent
