"""Automatic exposure: what it measures, how it adapts, and that nothing of it is there where the view gives it."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch07.hdr import model
from chapters.ch07.settings import Settings
from common.environment import constant
from common.errors import UserError
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Perspective, View, exposure
from tests.support.glowing import exposure_of, glow_of, glowing
from tests.support.gpu_functions import evaluate
from tests.support.scenes import facing, quad_scene
from tests.twins.hdr import box_reduced, log_average, luminance

pytestmark = pytest.mark.variants("vulkan", "gl")

PLAIN = Settings(ambient=0.0, default_light=False, color_format="rgba32f", msaa=1)
MODES = ("histogram", "mips")
STEP = model.LOG2_RANGE[1] - model.LOG2_RANGE[0]
BIN_ERROR = STEP / model.BINS / 512
"""Half of a bin's fixed-point step, in stops: the most that one pixel is rounded by."""

CLOSE = {"rtol": BIN_ERROR * math.log(2.0) + 2e-5}
"""That rounding as a part of the exposure, and some steps of float32 in log2, exp2 and the sums."""

LINEAR = {"color", "color_linear"}


def settings(mode, **more):
    return replaced(PLAIN, exposure=mode, **more)


def some_nits(shape=(24, 40), low=1e-2, high=1e4, seed=3):
    """Return colours (H, W, 3) in nits over many stops."""
    rng = np.random.default_rng(seed)
    levels = low * (high / low) ** rng.random(shape)
    return levels[..., None] * rng.uniform(0.3, 1.0, (*shape, 3))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "nits", [1e-3, pytest.param(0.7, marks=pytest.mark.long), pytest.param(40.0, marks=pytest.mark.long), 1e6]
)
def test_a_constant_picture_has_the_exposure_of_the_closed_form(chapter, mode, nits):
    """The first frame has the view's exposure, the second k / L; linear outputs are nits in both."""
    with closing(
        chapter.open(quad_scene(glow_of(nits)), (16, 16), settings(mode), outputs=LINEAR)
    ) as renderer:
        view = facing(ev100=math.log2(nits) + 1.0)
        first, second = renderer.render(view), renderer.render(view)
        assert exposure_of(renderer, first) == pytest.approx(exposure(view.ev100), rel=1e-6)
        np.testing.assert_allclose(exposure_of(renderer, second), 0.18 / nits, **CLOSE)
        for frame in (first, second):
            np.testing.assert_allclose(frame.image("color_linear"), nits, rtol=1e-5)


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 100.0), pytest.param(50.0, 95.0, marks=pytest.mark.core), (10.0, 10.5)]
)
def test_the_histogram_averages_between_percentiles(chapter, low, high):
    """Against a sort of all pixels. A part of a bin counts at the bin's mean: a narrow cut is off by part of a bin."""
    nits = some_nits()
    knobs = settings("histogram", exposure_low=low, exposure_high=high)
    with closing(chapter.open(glowing(nits), nits.shape[1::-1], knobs, outputs=LINEAR)) as renderer:
        view = facing(ev100=5.0)
        shown = luminance(renderer.render(view).image("color_linear"))
        found = math.log2(0.18 / exposure_of(renderer, renderer.render(view)))
    wanted = log_average(shown, low / 100, high / 100)
    bins = STEP / model.BINS
    share = min(1.0, 2 * shown.size * bins / 20 / max(shown.size * (high - low) / 100, 1.0))
    assert abs(found - wanted) < bins * share + BIN_ERROR + 1e-4


@pytest.mark.feature("hdr/luminance-mips")
@pytest.mark.parametrize("size", [(64, 64), (37, 53), (150, 70)])
def test_the_last_mip_is_the_mean_of_the_64x64_luminance(chapter, size):
    """And the 64x64 texels are area averages: their mean is that of the picture, at any size, with one bright pixel."""
    nits = some_nits(size[::-1], high=50.0)
    nits[5, 7] = 30_000.0
    with closing(chapter.open(glowing(nits), size, settings("mips"), outputs=LINEAR)) as renderer:
        view = facing(ev100=5.0)
        shown = luminance(renderer.render(view).image("color_linear"))
        found = 0.18 / exposure_of(renderer, renderer.render(view))
    texels = box_reduced(shown, 64)
    np.testing.assert_allclose(texels.mean(), shown.mean(), rtol=1e-12)
    np.testing.assert_allclose(found, texels.mean(), rtol=2e-6)
    if size[0] > 64:  # one tap for each texel would see other pixels, or the bright one not at all
        rows, columns = ((np.arange(64) + 0.5) * side / 64 for side in shown.shape)
        tapped = shown[np.ix_(rows.astype(int), columns.astype(int))].mean()
        assert abs(found / tapped - 1.0) > 0.01


@pytest.mark.feature("hdr/light-adaptation")
def test_adaptation_by_the_books_factor(vulkan_device):
    """The error after n frames is e0 * 0.941192^n, below 1 % after 76 frames and not before, in 32-bit storage."""
    factor = 0.98 ** (30 * 0.1)
    assert factor == pytest.approx(0.941192, abs=5e-7)
    frames = 100
    for start, target in ((50.0, 1.0), (0.01, 1.0)):
        body = """
            float value = start;
            for (int i = 0; i < count; ++i) { value = adapted(value, target, 0.1, 30.0); }
            after = value;"""
        numbers = np.arange(frames + 1, dtype=np.int32)
        inputs = {
            "count": numbers,
            "start": np.full(frames + 1, start, np.float32),
            "target": np.full(frames + 1, target, np.float32),
        }
        after = evaluate(vulkan_device, ["adaptation.glsl"], body, inputs, {"after": "float"})["after"]
        error = (after.astype(np.float64) - target) / (start - target)
        # Each step rounds the value once or twice, and later steps shrink what an earlier one rounded.
        rounding = 4 * np.spacing(np.float32(max(start, target))) / (1 - factor) / abs(start - target)
        np.testing.assert_allclose(error, factor**numbers, rtol=1e-5, atol=rounding)
        assert error[75] > 0.01 > error[76]


@pytest.mark.feature("hdr/light-adaptation")
def test_half_precision_would_stand_still_before_the_target():
    """The same step stored as half: it stops where a step is below half of the distance to the next number."""
    factor = 0.98 ** (30 * 0.1)
    for start, stops in ((50.0, 1.0078), (0.01, 0.9961)):
        values = {dtype: dtype(start) for dtype in (np.float16, np.float32)}
        for _ in range(1000):
            values = {
                dtype: dtype(np.float64(value) + (1.0 - np.float64(value)) * (1 - factor))
                for dtype, value in values.items()
            }
        assert float(values[np.float16]) == pytest.approx(stops, abs=1e-4)
        assert abs(float(values[np.float16]) - 1.0) > 0.003
        assert abs(float(values[np.float32]) - 1.0) < 2e-6


def test_steps_of_any_length_adapt_alike(vulkan_device):
    """Two steps give the same as one of their length; a time constant of 0 is at once; no time changes nothing."""
    rng = np.random.default_rng(5)
    count = 500
    inputs = {
        name: rng.uniform(low, high, count).astype(np.float32)
        for name, low, high in (("from", -20, 20), ("to", -20, 20), ("tau", 0.01, 3), ("dt", 0, 2))
    }
    inputs = {f"{name}_": values for name, values in inputs.items()}
    body = """
        whole = approached(from_, to_, tau_, dt_);
        parts = approached(approached(from_, to_, tau_, 0.25 * dt_), to_, tau_, 0.75 * dt_);
        at_once = approached(from_, to_, 0.0, dt_);
        never = approached(from_, to_, tau_, 0.0);"""
    names = ("whole", "parts", "at_once", "never")
    got = evaluate(vulkan_device, ["adaptation.glsl"], body, inputs, dict.fromkeys(names, "float"))
    start, to, tau, dt = (inputs[f"{name}_"].astype(np.float64) for name in ("from", "to", "tau", "dt"))
    np.testing.assert_allclose(got["whole"], to + (start - to) * np.exp(-dt / tau), atol=2e-5)
    np.testing.assert_allclose(got["parts"], got["whole"], atol=2e-5)
    np.testing.assert_allclose(got["at_once"], to, rtol=1e-6)
    np.testing.assert_allclose(got["never"], start, atol=4e-6)


def walk(renderer, scene, levels, step_s):
    """Render frames `step_s` apart while the square emits `levels`; return exposures and frames' finiteness."""
    exposures, finite = [], True
    for number, nits in enumerate(levels):
        with scene.edit() as edit:
            edit.set_material(0, glow_of(nits))
        frame = renderer.render(facing(ev100=0.0), number * step_s)
        exposures.append(exposure_of(renderer, frame))
        finite &= bool(np.isfinite(frame.image("color_linear")).all())
    return np.array(exposures), finite


@pytest.mark.feature("hdr/light-adaptation")
@pytest.mark.parametrize(("dark", "bright"), [(1.2, 0.3), (0.4, 0.0)])
def test_exposure_follows_in_seconds(chapter, dark, bright):
    """log2 of the exposure goes towards the target by 1 - exp(-dt / tau), with a tau for each direction."""
    levels = [1.0, 1.0, *[200.0] * 5, *[3.0] * 6]
    scene = quad_scene(glow_of(1.0))
    knobs = settings("histogram", adapt_dark_s=dark, adapt_bright_s=bright)
    with closing(chapter.open(scene, (8, 8), knobs, outputs=LINEAR)) as renderer:
        found, finite = walk(renderer, scene, levels, 0.1)
    wanted = [math.log2(exposure(0.0)), math.log2(0.18)]
    for number in range(1, len(levels) - 1):
        target = math.log2(0.18 / levels[number])
        tau = dark if target > wanted[-1] else bright
        wanted.append(target + (wanted[-1] - target) * (math.exp(-0.1 / tau) if tau else 0.0))
    assert finite
    np.testing.assert_allclose(np.log2(found), wanted, atol=BIN_ERROR * 3 + 1e-4)
    assert found[7] < found[2] / 2 and found[-1] > found[7] * 1.2, "it went both ways"


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("color_format", ["rgba16f", "rgba32f"])
def test_from_darkness_to_a_million_nits_nothing_overflows(chapter, mode, color_format):
    levels = [0.0, 0.0, 1e-4, 1e-4, *[1e6] * 8, 0.0, 0.0, 1e6]
    scene = quad_scene(glow_of(0.0))
    fast = {"adapt_dark_s": 0.5, "adapt_bright_s": 0.2, "adapt_speed": 0.3, "color_format": color_format}
    with closing(chapter.open(scene, (8, 8), settings(mode, **fast), outputs=LINEAR)) as renderer:
        found, finite = walk(renderer, scene, levels, 1.0)
        assert finite
        assert np.isfinite(found).all() and (found > 0).all()
        assert found.max() <= exposure(-8.0) * (1 + 1e-5)
        # Where the first bright picture was clipped at 65504, the way takes a few frames more.
        assert found[11] == pytest.approx(0.18 / 1e6, rel=0.05)


def test_a_picture_of_the_background_alone_keeps_the_views_exposure(chapter):
    """Its grey is given in picture values: measured as light of the scene it would drive the exposure away."""
    with closing(
        chapter.open(quad_scene(matrices=()), (16, 9), settings("histogram"), outputs=LINEAR)
    ) as renderer:
        frames = [exposure_of(renderer, renderer.render(facing(ev100=3.0), 0.1 * i)) for i in range(4)]
    np.testing.assert_allclose(frames, exposure(3.0), rtol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_a_sky_is_light_and_the_background_is_none(chapter, mode):
    """A constant sky of 80 nits behind a black square, against the same without a sky."""
    scene = replace(glowing(np.full((1, 1), 500.0)), environment=constant((80.0, 80.0, 80.0)))
    small = {"environment_size": 16, "irradiance_source": 4, "table_size": 8, "table_samples": 16}
    pose = pose_looking_at((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    view = View(pose, Perspective(1.0, 0.1), ev100=5.0)
    found = []
    for sky in (True, False):
        knobs = settings(mode, sky=sky, exposure_low=0.0, exposure_high=100.0, **small)
        with closing(chapter.open(scene, (24, 24), knobs, outputs={*LINEAR, "depth"})) as renderer:
            first = renderer.render(view)
            shown, depth = luminance(first.image("color_linear")), first.image("depth")
            found.append(0.18 / exposure_of(renderer, renderer.render(view)))
        counts = shown if sky else shown[depth > 0] if mode == "histogram" else np.where(depth > 0, shown, 0)
        wanted = 2 ** log_average(counts, 0.0, 1.0) if mode == "histogram" else counts.mean()
        np.testing.assert_allclose(found[-1], wanted, rtol=1e-3)
    assert (found[1] > found[0]) == (mode == "histogram")


@pytest.mark.parametrize("mode", MODES)
def test_equal_calls_give_equal_bits(chapter, mode):
    """In another renderer, and after a reset of the same one; a cut has the view's exposure again."""
    nits = some_nits()
    views = [facing(ev100=5.0), facing(2.0, 0.7, 5.0), facing(2.0, 0.4, 5.0)]

    def pictures(renderer):
        frames = []
        for number, view in enumerate(views):
            frame = renderer.render(view, 0.1 * number)
            frames.append((exposure_of(renderer, frame), frame.image("color")))
        return frames

    opened = [chapter.open(glowing(nits), (40, 24), settings(mode), outputs=LINEAR) for _ in range(2)]
    with closing(opened[0]) as one, closing(opened[1]) as other:
        runs = [pictures(one), pictures(other)]
        one.reset_history("a test")
        runs.append(pictures(one))
        cut = one.render(replace(views[0], cut=True), 1.0)
        assert exposure_of(one, cut) == pytest.approx(exposure(5.0), rel=1e-6)
    for run in runs[1:]:
        for (value, picture), (wanted, shown) in zip(run, runs[0], strict=True):
            assert value == wanted and np.array_equal(picture, shown)
    assert runs[0][1][0] != runs[0][2][0], "the exposure changes"


def test_a_frame_without_automatic_exposure_has_nothing_of_it(chapter):
    """No pass, buffer or pipeline; the picture is that of the first frame with it, which has the same exposure."""
    scene, view = glowing(some_nits()), facing(ev100=5.0)
    pictures, names, counts = [], [], []
    for mode in ("view", *MODES):
        with closing(chapter.open(scene, (40, 24), settings(mode), outputs=LINEAR)) as renderer:
            frame = renderer.render(view)
            pictures.append({name: frame.image(name) for name in LINEAR})
            names.append([step.name for step in renderer.graph.steps])
            counts.append((frame.work["dispatches"], frame.work["pipelines"]))
            memory = renderer._data.exposures
            assert bool(memory.told) == (mode != "view")
            assert ("exposure_told" in renderer.graph.resources) == (mode != "view")
    assert {"histogram", "luminance", "adapt_histogram", "adapt_mips"}.isdisjoint(names[0])
    assert set(names[1]) - set(names[0]) == {"histogram", "adapt_histogram"}
    assert set(names[2]) - set(names[0]) == {"luminance", "adapt_mips"}
    for dispatches, pipelines in counts[1:]:
        assert (dispatches, pipelines) == (counts[0][0] + 2, counts[0][1] + 2)
    for shown in pictures[1:]:
        for name in LINEAR:
            assert np.array_equal(shown[name], pictures[0][name])


@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_with_the_views_exposure_a_picture_is_that_of_pre_exposed_light(chapter, graph):
    """Chapter 6 multiplies environment, ambient light and emission on the CPU: at most a step of half precision."""
    scene = replace(glowing(some_nits((9, 16))), environment=constant((900.0, 300.0, 50.0)))
    small = {"environment_size": 16, "irradiance_source": 4, "table_size": 8, "table_samples": 16}
    pose = pose_looking_at((0.5, 0.2, 4.0), (0.0, 0.0, 0.0))
    view = View(pose, Perspective(1.0, 0.1), ev100=7.3)
    pictures = []
    for which in (chapter.which, 6):
        module, of = chapters.renderer_module(which, chapter.backend), chapters.settings_class(which)
        knobs = replaced(of(), ambient=3.0, graph=graph, color_format="rgba16f", msaa=1, **small)
        with module.Renderer(
            scene, (16, 9), knobs, device=chapter.device, outputs={"color_linear"}
        ) as renderer:
            pictures.append(renderer.render(view).image("color_linear"))
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=2.0**-10)


@pytest.mark.parametrize("mode", MODES)
def test_without_its_pass_a_frame_has_the_views_exposure(chapter, mode):
    """A user may switch the pass off and on again between frames; outputs in nits are right in each."""
    nits, view = some_nits((8, 8)), facing(ev100=5.0)
    with closing(chapter.open(glowing(nits), (8, 8), settings(mode), outputs=LINEAR)) as renderer:
        found, linear = [], []
        for on in (True, True, False, False, True, True):
            if renderer.switches[f"adapt_{mode}"] != on:
                renderer.switch_pass(f"adapt_{mode}", on)
            frame = renderer.render(view if on else facing(2.0, 0.4, 5.0))
            linear.append(frame.image("color_linear"))
            found.append(renderer._data.exposures.of_frame(frame._slot.index, exposure(5.0)))
    found = np.array(found)
    np.testing.assert_allclose(found[[0, 2, 3, 4]], exposure(5.0), rtol=1e-6)
    assert found[1] == found[5] != found[0]
    for number, other in ((1, 0), (3, 2), (4, 0), (5, 0)):
        np.testing.assert_allclose(linear[number], linear[other], rtol=1e-5)


def test_a_window_draws_until_adaptation_rests(chapter):
    """By the time since the last change of the picture, and not before two frames have followed it."""
    view = facing(ev100=5.0)
    for mode in ("view", *MODES):
        with closing(chapter.open(glowing(some_nits((4, 4))), (8, 8), settings(mode))) as renderer:
            after, still = model.rest_after_s(renderer.settings), mode == "view"
            for number, shown in enumerate((view, facing(2.0, 0.7, 5.0))):
                begin = 10.0 * after * number
                renderer.render(shown, begin + 1.0)
                assert renderer.idle(shown, begin + 1.0) == renderer.idle(shown, begin + 1.1 + after) == still
                renderer.render(shown, begin + 1.1)
                renderer.render(shown, begin + 1.2)
                assert renderer.idle(shown, begin + 1.3) == still
                assert renderer.idle(shown, begin + 1.2), "time stands still, and nothing adapts"
                assert renderer.idle(shown, begin + 1.1 + after)
            renderer.render(shown, begin + 2.0 + after)
            assert renderer.idle(shown, begin + 2.1 + after) == still, (
                "it was drawn since something has changed"
            )


def test_without_time_constants_the_exposure_is_that_of_the_picture_before(chapter):
    """A window at rest shows what a further frame would show."""
    view = facing(ev100=5.0)
    at_once = settings("histogram", adapt_dark_s=0.0, adapt_bright_s=0.0)
    with closing(chapter.open(glowing(some_nits((4, 4))), (8, 8), at_once)) as renderer:
        frames = [renderer.render(view, 0.1 * number).image("color").copy() for number in range(2)]
        assert not renderer.idle(view, 0.2) and not np.array_equal(*frames)
        last = renderer.render(view, 0.2).image("color").copy()
        assert renderer.idle(view, 0.3)
        assert np.array_equal(renderer.render(view, 0.3).image("color"), last)


def test_the_time_until_rest():
    span, tau = 32.0, 1.2
    assert model.rest_after_s(settings("histogram")) == pytest.approx(tau * math.log(span * 256.0))


def test_limits_that_contradict_each_other_are_refused(chapter):
    for wrong, text in (
        ({"exposure_low": 95.0}, "exposure_low=95 leaves nothing below exposure_high=95"),
        ({"exposure_min_ev": 25.0}, "exposure_min_ev=25 is above exposure_max_ev=24"),
    ):
        with pytest.raises(UserError, match=text):
            chapter.open(quad_scene(), (8, 8), settings("histogram", **wrong))


def test_the_exposure_stays_within_its_limits(chapter):
    for mode in MODES:
        for nits, ev in ((1e-3, 4.0), (1e5, 9.0)):
            knobs = settings(mode, exposure_min_ev=4.0, exposure_max_ev=9.0)
            with closing(chapter.open(quad_scene(glow_of(nits)), (8, 8), knobs)) as renderer:
                frames = [renderer.render(facing(ev100=6.0)) for _ in range(2)]
                assert exposure_of(renderer, frames[1]) == pytest.approx(exposure(ev), rel=2e-5)


@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("mode", MODES)
def test_both_backends_find_the_same_exposure(chapter, gl_context, mode):
    """The same bits on the software drivers, whose compiler is one; elsewhere to a few roundings of float32."""
    nits, found = some_nits(), []
    for one in (chapter, replace(chapter, backend="gl", device=gl_context)):
        with one.open(glowing(nits), (40, 24), settings(mode)) as renderer:
            frames = (renderer.render(facing(ev100=5.0), 0.1 * number) for number in range(3))
            found.append([exposure_of(renderer, frame) for frame in frames])
    if chapter.device.capabilities.is_software and gl_context.capabilities.is_software:
        assert found[0] == found[1]
    np.testing.assert_allclose(found[0], found[1], **CLOSE)


@pytest.mark.long
@pytest.mark.parametrize(
    "mode", [MODES[0], *(pytest.param(mode, marks=pytest.mark.long) for mode in MODES[1:])]
)
def test_several_samples_and_poisoned_memory_change_nothing(chapter, mode):
    """With several samples the depth is that of another pass; what the frame before left in memory never counts."""
    nits, found = some_nits((16, 16)), []
    ways = ({}, {"poison": "depth 1"}, {"msaa": 4, "poison": "depth 1"})
    for way in ways:
        knobs = settings(mode, bloom=0.2, bloom_levels=2, color_format="rgba16f", **way)
        with closing(chapter.open(glowing(nits), (16, 16), knobs)) as renderer:
            frames = [renderer.render(facing(ev100=5.0), 0.1 * number) for number in range(3)]
            found.append((exposure_of(renderer, frames[2]), frames[2].image("color")))
    assert found[0][0] == found[1][0] and np.array_equal(found[0][1], found[1][1])
    np.testing.assert_allclose(found[2][0], found[0][0], rtol=1e-3)
