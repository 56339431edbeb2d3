"""Frames with a history: what it converges to, when it rests, when it begins anew, and what must not last in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.contract import Access
from chapters.ch11.pipelines.description import PipelineDescription
from chapters.ch11.post.fullscreen import FullscreenPass
from chapters.ch11.settings import Settings
from chapters.ch11.taa import model
from chapters.ch11.taa.jitter import SEQUENCES, offsets
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.settings import replaced
from common.view.camera import View
from tests.support.taa import (
    EVEN,
    FULL,
    PERIOD,
    SIZE,
    STEP,
    VIEW,
    brighter,
    court,
    frames_of,
    light,
    opened,
    steady_state,
)

pytestmark = pytest.mark.variants("vulkan", "gl")

BASE, PLAINLY = Settings(**FULL), Settings(**EVEN)
REST = model.REST_PERIODS * PERIOD
UNIT = 2.0**-24


@pytest.fixture(scope="module")
def scene():
    return court()


@pytest.fixture
def samples(chapter, scene):
    """The frames of a period, each alone."""
    with opened(chapter, PLAINLY, scene, taa_share=1.0) as renderer:
        return frames_of(renderer, PERIOD)


# --- what a view that stands still becomes ---


@pytest.mark.core
@pytest.mark.feature("taa/history")
def test_a_view_that_stands_still_is_the_mean_of_its_frames_and_rests(chapter, scene, samples):
    """In 32 bits each of n steps rounds a mean by at most a unit of the last place, so n units bound the error."""
    with opened(chapter, BASE, scene) as renderer:
        pictures, idle = [], []
        for _ in range(REST + 2):
            pictures.append(light(renderer.render(VIEW)))
            idle.append(renderer.idle(VIEW))
    assert np.array_equal(pictures[0], samples[0])
    for n in (1, PERIOD - 1, REST - 1):
        mean = np.mean([samples[k % PERIOD] for k in range(n + 1)], axis=0)
        assert np.abs(pictures[n] - mean).max() <= 2 * (n + 2) * UNIT * mean.max()
    assert idle == [False] * (REST - 1) + [True] * 3
    assert np.array_equal(pictures[REST], pictures[REST - 1])
    assert np.array_equal(pictures[REST + 1], pictures[REST - 1])
    assert np.abs(samples[0] - samples[1]).max() > 0.05 * samples[0].max()  # the jitter does move edges


@pytest.mark.feature("taa/simple")
def test_the_simple_mode_blends_a_tenth(chapter, scene, samples):
    with opened(chapter, Settings(**{**FULL, "taa": "simple"}), scene, mip_bias=0.0) as renderer:
        first, second, third = frames_of(renderer, 3)
    assert np.array_equal(first, samples[0])
    for found, before, now in ((second, first, samples[1]), (third, second, samples[2])):
        assert np.abs(found - (0.9 * before + 0.1 * now)).max() <= 8 * UNIT * now.max()
        assert not np.array_equal(found, before)


@pytest.mark.feature("taa/simple")
@pytest.mark.parametrize(("form", "unit"), [("rgba32f", UNIT), ("rgba16f", 2.0**-11)])
def test_a_history_without_constraint_reaches_its_periodic_state(chapter, scene, samples, form, unit):
    """The state of the recurrence in float64. A format of relative step 2 u stands still within u / share of it."""
    share, count = 0.2, 16 * PERIOD
    with opened(chapter, PLAINLY, scene, taa_share=share, taa_format=form) as renderer:
        found = frames_of(renderer, count)[-PERIOD:]
    left = (1.0 - share) ** (count - PERIOD)  # of the first frame
    for state, picture in zip(steady_state(samples, share), found, strict=True):
        assert np.abs(picture - state).max() <= (unit / share + 4 * UNIT / share + left) * state.max()


@pytest.mark.feature("taa/history")
def test_a_view_that_has_moved_rests_later_and_close_to_its_mean(chapter, scene, samples):
    """What was before has the weight RESIDUE at most in the end."""
    with opened(chapter, BASE, scene) as renderer:
        frames_of(renderer, 5, STEP)
        rested = []
        while not renderer.idle(VIEW):
            rested.append(light(renderer.render(VIEW)))
        assert len(rested) == REST + (1 + model.short_means(PERIOD)) * PERIOD
        after = frames_of(renderer, 2)
    mean = np.mean(samples, axis=0)
    assert np.array_equal(after[0], rested[-1]) and np.array_equal(after[1], rested[-1])
    assert np.abs(rested[-1] - mean).max() < model.RESIDUE * mean.max()
    assert np.sqrt(np.mean((rested[-1] - mean) ** 2)) < 0.1 * np.sqrt(np.mean((samples[0] - mean) ** 2))


@pytest.mark.feature("taa/history")
def test_an_edit_ends_the_rest(chapter):
    scene = court()
    with opened(chapter, BASE, scene) as renderer:
        frames_of(renderer, REST)
        assert renderer.idle(VIEW)
        with scene.edit() as edit:
            edit.set_light(0, replace(scene.lights[0], intensity=30.0))
        assert not renderer.idle(VIEW)
        frames_of(renderer, REST + (1 + model.short_means(PERIOD)) * PERIOD)
        assert renderer.idle(VIEW)
        dimmed = light(renderer.render(VIEW))
    with opened(chapter, BASE, scene) as renderer:
        alone = frames_of(renderer, REST)[-1]
    assert np.abs(dimmed - alone).max() < 2 * model.RESIDUE * alone.max()


# --- when a history begins anew ---


@pytest.mark.feature("taa/history")
def test_first_frames_cuts_and_sizes_show_the_current_colour(chapter, scene, samples):
    with opened(chapter, BASE, scene) as renderer:
        for again in (
            lambda: renderer.render(VIEW),
            lambda: renderer.render(replace(VIEW, cut=True), 0.5),
            lambda: (renderer.reset_history("test"), renderer.render(VIEW, 0.5))[1],
            lambda: (renderer.resize((20, 16)), renderer.resize(SIZE), renderer.render(VIEW, 0.5))[2],
            lambda: (renderer.render(VIEW, 1.0), renderer.render(VIEW, 0.25))[1],
        ):
            frame = again()
            assert np.array_equal(light(frame), samples[0]), frame.reset
            assert not np.array_equal(light(renderer.render(VIEW, 0.5)), samples[0])
            renderer.render(STEP, 0.5)


@pytest.mark.feature("taa/history")
def test_images_take_turns_and_nothing_is_copied(chapter, scene):
    with opened(chapter, BASE, scene) as renderer:
        renderer.render(VIEW)
        resource = renderer.graph.resources[renderer.graph.names["history_color"]]
        assert resource.life == "history"
        reading = [step.name for step in renderer.graph.steps if "history_color" in step.reads]
        assert "taa" in {step.name for step in renderer.graph.steps} and reading
        assert not [step for step in renderer.graph.steps if step.kind == "copy" and "taa" in step.name]


@pytest.mark.feature("taa/history")
def test_a_longer_exposure_scales_the_history(chapter, scene, samples):
    """Light divided by the exposure stays what it was."""
    with opened(chapter, PLAINLY, scene, taa_share=0.25) as renderer:
        before = frames_of(renderer, 4)[-1]
        found = light(renderer.render(brighter(VIEW, 3.0)))
    truth = 0.75 * before + 0.25 * samples[0]
    assert np.abs(found - truth).max() <= 16 * UNIT * truth.max()


class Holed(FullscreenPass):
    """Copies the picture, with a pixel that is not a number while `holed`."""

    name = "holed"
    reads = (Access("color_hdr", "sampled"),)
    writes = (Access("color_holed", "color", format="rgba32f"),)
    file = ""
    holed = False

    def describe(self):
        return PipelineDescription(
            shaders=("post/fullscreen.vert", self.file), color="rgba32f", depth=None, name="holed"
        )

    def create(self):
        self.pipelines = self._pipelines.get(
            [replace(self.describe(), defines=(("HOLE", hole),)) for hole in (0, 1)]
        )

    def record(self, commands):
        commands.draw_fullscreen(self.pipelines[self.holed], self._draws.binding)

    def key(self, slot):
        return self.holed


HOLE = """
layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;
void main() {
    out_color = texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0);
    if (HOLE != 0 && ivec2(gl_FragCoord.xy) == ivec2(20, 15)) {
        out_color.rgb = vec3(uintBitsToFloat(0x7fc00000u));
    }
}
"""


@pytest.mark.feature("taa/history")
@pytest.mark.parametrize(
    ("history", "moves"),
    [
        *(("bilinear", False), ("catmull-rom", True)),
        *(pytest.param(*it, marks=pytest.mark.long) for it in (("bilinear", True), ("catmull-rom", False))),
    ],
)
def test_a_texel_that_is_not_a_number_is_gone_one_frame_later(chapter, scene, tmp_path, history, moves):
    file = tmp_path / "hole.frag"
    file.write_text(HOLE)
    with opened(chapter, BASE, scene, taa_history=history, taa_average=False) as renderer:
        gpu_pass = renderer.make_pass(Holed)
        gpu_pass.file = str(file)
        # From chapter 12 on, traced rays come before.
        taken = "color_traced" if "color_traced" in renderer.graph.names else "color_hdr"
        renderer.insert_pass(gpu_pass, {"taa": {taken: "color_holed"}})
        gpu_pass.holed = True  # the first frame is its history, as it is
        assert np.isnan(frames_of(renderer, 1)[0]).any()
        gpu_pass.holed = False
        after = frames_of(renderer, 1, STEP if moves else VIEW)[0]
    assert np.isfinite(after).all()


# --- moving cameras ---


@pytest.mark.feature("taa/history")
def test_what_comes_into_the_picture_is_the_current_colour(chapter, scene):
    """A camera that turns by half a picture: the half that was not seen has no history."""
    turned = replace(VIEW, world_from_view=VIEW.world_from_view @ _turn(-0.5))
    with opened(chapter, BASE, scene, "motion") as renderer:
        frames_of(renderer, 3)
        frame = renderer.render(turned)
        found, motion = light(frame), frame.image("motion")
    with opened(chapter, BASE, scene, taa_share=1.0, taa_average=False) as renderer:
        frames_of(renderer, 3)
        alone = light(renderer.render(turned))
    y, x = np.indices(found.shape[:2]) + 0.5
    before = x / SIZE[0] - motion[..., 0], y / SIZE[1] - motion[..., 1]
    inside = (before[0] > 0) & (before[0] < 1) & (before[1] > 0) & (before[1] < 1)
    edge = np.minimum.reduce(
        [np.abs(before[0]), np.abs(1 - before[0]), np.abs(before[1]), np.abs(1 - before[1])]
    )
    outside = ~inside & (edge > 0.06)  # the 3x3 may follow a vector of a neighbour
    assert outside.sum() > 100 and np.array_equal(found[outside], alone[outside])
    assert (found[inside] != alone[inside]).mean() > 0.2


def _turn(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0, sine, 0], [0, 1, 0, 0], [-sine, 0, cosine, 0], [0, 0, 0, 1]])


@pytest.mark.feature("taa/history")
@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_transparent_surfaces_take_from_the_history(chapter, graph):
    """Each frame's weight w.y falls by the cover times the knob, and the sum is divided by the weights."""
    cover = 0.6
    scene = court(Material(alpha_mode="blend", base_color=(0.8, 0.6, 0.4, cover), double_sided=True))

    def second(**turned):
        with opened(chapter, PLAINLY, scene, graph=graph, **turned) as renderer:
            return frames_of(renderer, 2)

    now = second(taa_share=1.0, taa_reactive=0.0)[1]
    first, kept = second(taa_share=0.25, taa_reactive=0.0)
    reactive = second(taa_share=0.25, taa_reactive=0.5)[1]
    assert np.abs(kept - (0.25 * now + 0.75 * first)).max() < 16 * UNIT * now.max()
    one = 0.75 * (1 - 0.5 * cover), 0.75 * (1 - 0.5 * (1 - (1 - cover) ** 2))  # a layer, two layers
    options = [(0.25 * now + weight * first) / (0.25 + weight) for weight in (0.75, *one)]
    apart = np.min([np.abs(reactive - option).max(axis=-1) for option in options], axis=0)
    changed = np.abs(now - first).max(axis=-1) > 0.02 * now.max()
    # A pixel may have three layers in one of the frames.
    assert changed.sum() > 10 and (apart[changed] < 1e-3 * now.max()).mean() > 0.8
    assert (np.abs(reactive - kept).max(axis=-1)[changed] > 1e-3 * now.max()).mean() > 0.5


@pytest.mark.feature("taa/velocity-selection")
def test_inside_of_a_surface_a_pixel_follows_its_own_vector(chapter):
    """The camera comes closer to the ground, so neighbours have other vectors, and all of them are the ground."""
    views = [
        View(pose_looking_at((2.2, 1.6 - 0.1 * n, 2.0), (1.6, 0.0, 1.5)), VIEW.projection) for n in range(3)
    ]
    shown = {}
    for name in ("own", "closest", "longest"):
        with opened(chapter, Settings(**FULL), court(), "instance_id", taa_velocity=name) as renderer:
            frames = [renderer.render(view) for view in views]
            assert len(np.unique(frames[-1].image("instance_id"))) == 1, "another surface is in view"
            shown[name] = light(frames[-1])
    assert np.array_equal(shown["closest"], shown["own"])
    assert not np.array_equal(shown["longest"], shown["own"])


# --- what jitter must not touch ---


@pytest.mark.feature("taa/jitter-sequences")
@pytest.mark.parametrize("name", SEQUENCES)
def test_shaders_know_the_jitter_of_this_frame_and_of_the_one_before(chapter, scene, name):
    """In ndc: a pixel is 2 / size. A period begins again after its last frame, and so does a sequence after a cut."""
    shifts = offsets(name, PERIOD) * 2 / np.array(SIZE)
    with opened(chapter, BASE, scene, jitter=name, taa_average=False) as renderer:
        for n in range(PERIOD + 2):
            frame = renderer.render(VIEW)
            slots = [slot.frame.view(layouts.dtype("FrameConstants"))[0] for slot in renderer._data.slots]
            (own,) = (it for it in slots if it["frame_index"] == frame.index and it["size"][0] == SIZE[0])
            assert np.allclose(own["jitter"], shifts[n % PERIOD], atol=1e-7)
            assert np.allclose(own["previous_jitter"], shifts[max(n - 1, 0) % PERIOD], atol=1e-7)
        renderer.render(replace(VIEW, cut=True))
        slots = [slot.frame.view(layouts.dtype("FrameConstants"))[0] for slot in renderer._data.slots]
        assert any(np.allclose(slot["jitter"], shifts[0], atol=1e-7) for slot in slots)
    assert len(np.unique(np.round(shifts, 9), axis=0)) == PERIOD


@pytest.mark.feature("taa/projection-jitter")
@pytest.mark.parametrize("msaa", [1, 4])
def test_ids_and_motion_have_no_jitter(chapter, scene, msaa):
    """With several samples a pixel they have a depth of their own, and the depth of the history keeps its jitter."""
    with opened(chapter, BASE, scene, "instance_id", taa="off", msaa=msaa) as renderer:
        steady = renderer.render(VIEW).image("instance_id")
    depths = []
    with opened(chapter, BASE, scene, "instance_id", "motion", "depth", msaa=msaa) as renderer:
        for _ in range(PERIOD + 1):
            frame = renderer.render(VIEW)
            assert np.array_equal(frame.image("instance_id"), steady)
            assert not frame.image("motion").any()
            depths.append(frame.image("depth").copy())
    assert not np.array_equal(depths[0], depths[1]) and np.array_equal(depths[0], depths[PERIOD])


@pytest.mark.feature("taa/history")
def test_without_it_nothing_is_made(chapter, scene):
    with opened(chapter, BASE, scene, taa="off") as renderer:
        frame = renderer.render(VIEW)
        names = {gpu_pass.name for gpu_pass in renderer.passes}
        assert not names & {"taa", "motion", "motion_objects"}
        assert "history_color" not in renderer.graph.resources and "taa_frames" not in frame.work
        assert renderer.idle(VIEW)


@pytest.mark.feature("taa/history")
def test_a_pass_that_is_switched_off_leaves_no_jitter(chapter, scene):
    with opened(chapter, BASE, scene, taa="off") as renderer:
        steady = light(renderer.render(VIEW))
    with opened(chapter, BASE, scene, mip_bias=0.0) as renderer:
        frames_of(renderer, 3)
        renderer.switch_pass("taa", False)
        for _ in range(2):
            assert np.array_equal(light(renderer.render(VIEW)), steady) and renderer.idle(VIEW)
        renderer.switch_pass("taa", True)
        frames_of(renderer, 2)
        assert not np.array_equal(light(renderer.render(VIEW)), steady)


# --- all modes ---

MODES = (
    {"taa": "simple", "graph": "deferred"},
    {
        "graph": "compute",
        "taa_velocity": "longest",
        "taa_history": "bilinear",
        "taa_ycocg": False,
        "taa_weight": "contrast",
    },
    {"graph": "deferred", "taa_filter": "mitchell", "taa_constraint": "clip", "taa_weight": "luminance"},
    {"taa_filter": "blackman-harris", "taa_constraint": "clamp", "taa_velocity": "own", "jitter": "r2"},
    {"taa_filter": "catmull-rom", "taa_constraint": "variance", "steady_uv": True, "jitter": "hammersley"},
    {"taa_filter": "tent", "taa_format": "rgba16f", "jitter": "interleaved-gradient", "taa_weight": "fixed"},
)


@pytest.fixture(scope="module")
def stepped(chapter, scene):
    """The frame of STEP without a history."""
    with opened(chapter, BASE, scene, taa="off") as renderer:
        return light(renderer.render(STEP))


@pytest.mark.feature("taa/history")
@pytest.mark.parametrize("mode", range(len(MODES)))
def test_each_mode_is_finite_and_follows_a_camera(chapter, scene, stepped, mode):
    """Four frames of a camera that moves stay near the frame without history, in the mean over the picture."""
    with opened(chapter, replaced(BASE, **MODES[mode]), scene) as renderer:
        pictures = [light(renderer.render(view)) for view in (VIEW, STEP, VIEW, STEP)]
    assert np.isfinite(pictures).all() and min(picture.min() for picture in pictures) >= 0.0
    assert np.abs(pictures[-1] - stepped).mean() < 0.08 * stepped.mean()
    assert not np.array_equal(pictures[-1], stepped)


@pytest.mark.long
@pytest.mark.feature("taa/history")
def test_ten_thousand_frames_do_not_drift(chapter, scene, samples):
    """An exponential average in 32 bits stays within u / share of its periodic state, however long it goes on."""
    share = 0.1
    with opened(chapter, PLAINLY, scene, taa_share=share) as renderer:
        for _ in range(10_000 - PERIOD):
            renderer.render(VIEW)
        found = frames_of(renderer, PERIOD)
    for state, picture in zip(steady_state(samples, share), found, strict=True):
        assert np.abs(picture - state).max() <= 8 * UNIT / share * state.max()
