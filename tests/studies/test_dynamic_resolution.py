"""The study dynamic-resolution: frames at eight scales continue one history, and are prepared once.

The controller has tests of its own, test_resolution_controller.py.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch11.settings import Settings as ChapterSettings
from chapters.ch11.studies.dynamic_resolution import Settings
from chapters.ch11.studies.dynamic_resolution.controller import COUNT, LATE, SCALES, WINDOW
from chapters.ch11.taa import jitter, model
from common.errors import SettingError, StaleFrameError, UserError
from common.scene import Image, Material, Sampler
from common.settings import apply_overrides, replaced
from tests.support.scenes import texture
from tests.support.shadows import PLAIN, point, yard
from tests.support.taa import SIZE, STEP, VIEW, court, light
from tests.twins import upscale as twin

WHICH = "11/dynamic-resolution"
UNIT = 2.0**-24
PERIOD = 64
"""Frames of a period of jitter: 16 samples of each pixel at half of the sides."""
BASE = {**PLAIN, "shadows": "off"}
ORDER = (7, 0, 3, 5, 1, 6, 2, 4)


@pytest.fixture(scope="module")
def scene():
    return court()


def opened(stage, scene, *outputs, size=SIZE, inspect=False, **turned):
    settings = Settings(**{**BASE, **turned})
    more = {"inspect": True} if inspect else {}
    return stage.open(WHICH, size, scene, settings=settings, outputs={"color_linear", *outputs}, **more)


def textured(lamps=1):
    """Return the court with a texture of noise that has levels, and with so many lamps."""
    texels = np.random.default_rng(3).integers(0, 256, (64, 64, 4), np.uint8)
    texels[..., 3] = 255
    smooth = Sampler("linear", "linear", "linear")
    material = Material(
        roughness=1.0, metallic=0.0, base_color_texture=texture(sampler=smooth), double_sided=True
    )
    places = [point((-1.2 + 0.3 * number, 3.0, 0.8), candela=60.0 / lamps) for number in range(lamps)]
    return replace(yard(*places, material=material), images=[Image("noise", texels)])


# --- what the history becomes ---


def test_the_history_is_the_mean_of_samples_that_were_drawn_at_eight_scales(stage, scene):
    """Against float64, from the images that were drawn; bounds as in the tests of pictures at one scale."""
    shifts = jitter.offsets("halton", PERIOD)
    with opened(stage, scene, inspect=True, graph="forward") as renderer:
        sums, most = [], 0.0
        for n in range(3 * COUNT):
            renderer.choose(ORDER[n % COUNT])
            frame = renderer.render(VIEW)
            drawn = frame.image("forward/color_hdr")[..., :3].astype(np.float64)
            side = SCALES[ORDER[n % COUNT]]
            assert drawn.shape[1::-1] == (round(SIZE[0] * side), round(SIZE[1] * side))
            sums.append(twin.sums(drawn, tuple(shifts[n]), SIZE, model.KERNEL_RADIUS))
            found = frame.image("taa/history_color")[..., :3].astype(np.float64)
            most = max(most, drawn.max())
            bound = (4 * max(SIZE) + 4 * (n + 2)) * UNIT * most
            assert np.abs(found - twin.mean(sums)).max() <= bound, n
            assert frame.work["history_resets"] == (n == 0)
            assert frame.work["taa_frames"] == n + 1
    assert np.abs(twin.mean(sums) - twin.mean(sums[-1:])).max() > 0.05 * most


def test_a_picture_at_rest_stays_as_it_is_to_the_bit_at_each_scale(stage, scene):
    """A first frame, as after a reset, is far from it."""
    with opened(stage, scene, "color") as renderer:
        while not renderer.idle(VIEW):
            frame = renderer.render(VIEW)
        rested, shown = light(frame), frame.image("color")
        frames = frame.work["taa_frames"]
        assert frames == model.REST_PERIODS * PERIOD
        for number in ORDER[1:]:
            renderer.choose(number)
            assert renderer.idle(VIEW)
            frame = renderer.render(VIEW)
            assert np.array_equal(light(frame), rested) and np.array_equal(frame.image("color"), shown)
            assert (frame.work["history_resets"], frame.work["taa_frames"]) == (0, frames)
        renderer.reset_history("test")
        first = light(renderer.render(VIEW))
    assert np.sqrt(np.mean((first - rested) ** 2)) > 0.02 * rested.max()


def test_a_moving_view_keeps_its_history_through_changes(stage, scene):
    """With a share of a tenth, a frame at half of the sides changes the picture by a tenth of what it alone shows."""
    still = {"taa_average": False, "taa_constraint": "none", "taa_weight": "fixed", "taa_tolerance": 0.0}
    with opened(stage, scene, **still) as renderer:
        for _ in range(40):
            before = light(renderer.render(VIEW))
        renderer.choose(0)
        frame = renderer.render(VIEW)
        after = light(frame)
        assert frame.work["history_resets"] == 0
        renderer.reset_history("test")
        fresh = light(renderer.render(VIEW))
        moved = light(renderer.render(STEP))
    change, alone = (np.sqrt(np.mean((it - before) ** 2)) for it in (after, fresh))
    assert 0 < change < 0.2 * alone
    assert np.isfinite(moved).all()


@pytest.mark.parametrize("number", [0, 3])
@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_a_scale_that_stays_draws_the_picture_of_the_chapter(stage, number, graph):
    """Textures included: their level is read in each frame, where the chapter's is compiled."""
    scene = textured()
    turned = {**BASE, "graph": graph, "jitter_period": PERIOD, "taa": "full", "color_format": "rgba16f"}
    with opened(stage, scene, **turned, first_scale=0) as renderer:
        renderer.wait_loaded()
        renderer.choose(number)
        found = [light(renderer.render(VIEW)) for _ in range(3)]
    settings = ChapterSettings(**{**turned, "taa_scale": SCALES[number]})
    with chapters.open(
        11,
        stage.backend,
        scene=scene,
        size=SIZE,
        settings=settings,
        outputs={"color_linear"},
        device=stage.device,
    ) as renderer:
        renderer.wait_loaded()
        truth = [light(renderer.render(VIEW)) for _ in range(3)]
        assert np.array_equal(found, truth)
    with opened(stage, scene, **{**turned, "mip_bias": 1.0}, first_scale=number) as renderer:
        renderer.wait_loaded()
        assert np.abs(light(renderer.render(VIEW)) - truth[0]).max() > 0.01 * truth[0].max()


def test_outputs_have_the_size_of_the_picture_at_each_scale(stage, scene):
    outputs = ("color", "depth", "instance_id", "motion")
    with opened(stage, scene, *outputs) as renderer:
        for number in ORDER:
            renderer.choose(number)
            frame = renderer.render(STEP)
            for name in outputs:
                assert frame.image(name).shape[1::-1] == SIZE, (number, name)
            assert {*frame.timings} >= {"taa", "tonemap"}
            assert frame.work["scale_number"] == renderer.number == number


@pytest.mark.parametrize("culling", ["frustum", "occlusion"])
def test_culling_gives_the_same_picture_and_records_anew(stage, scene, culling):
    pictures = {}
    for mode in ("off", culling):
        with opened(stage, scene, culling=mode) as renderer:
            pictures[mode] = []
            for number in (7, 0, 7, 3, 0):
                renderer.choose(number)
                pictures[mode] += [light(renderer.render(VIEW)) for _ in range(2)]
    assert np.array_equal(pictures["off"], pictures[culling])


# --- what a change costs ---


@pytest.mark.parametrize("lamps", [1, 9])
def test_after_one_visit_of_each_scale_nothing_is_made_or_recorded(stage, lamps):
    """Nine lamps have lists, whose layout follows the scale."""
    scene = textured(lamps)
    with opened(stage, scene, graph="deferred") as renderer:
        renderer.wait_loaded()
        for number in ORDER:
            renderer.choose(number)
            for _ in range(2):
                frame = renderer.render(VIEW)
        assert (frame.work["scales_made"], frame.work["scales_prepared"]) == (COUNT, COUNT)
        made = len(stage.device.alive), frame.work["pipelines"], frame.work["descriptor_sets"]
        histories = _histories(renderer)
        for number in (*ORDER, *reversed(ORDER)):
            renderer.choose(number)
            for _ in range(2):
                frame = renderer.render(VIEW)
                assert frame.work["recorded"] == 0, number
            now = len(stage.device.alive), frame.work["pipelines"], frame.work["descriptor_sets"]
            assert now == made and frame.work["scales_made"] == COUNT
            assert _histories(renderer) == histories
        assert frame.work["scale_changes"] == len(ORDER) - 1 + 2 * len(ORDER) - 1


def _histories(renderer):
    """Return which images the histories of the frame that is drawn are, by slot."""
    images = renderer._api.executor.images
    names = [name for name, resource in renderer.graph.resources.items() if resource.life == "history"]
    assert {"history_color", "history_weight"} <= {*names}
    return [(name, id(images.image(slot, name))) for name in names for slot in (0, 1)]


def test_all_scales_have_the_pipelines_of_one(stage, scene):
    with opened(stage, scene) as renderer:
        one = renderer.render(VIEW).work["pipelines"]
        for number in ORDER:
            renderer.choose(number)
            assert renderer.render(VIEW).work["pipelines"] == one


def test_nothing_is_left_whatever_was_drawn_last(stage, scene):
    before = dict(stage.device.alive)
    for end in ("close", "resize", "rebuild", "reload"):
        with opened(stage, scene) as renderer:
            for number in (7, 0, 3, 0):
                renderer.choose(number)
                renderer.render(VIEW)
            if end == "resize":
                renderer.resize((24, 18))
            elif end == "rebuild":
                renderer.show_resource("history_color")
            elif end == "reload":
                renderer._frames.forget()  # as an edit of a shader does
            frame = renderer.render(VIEW)
            assert np.isfinite(light(frame)).all()
            assert frame.reset == ("resize" if end == "resize" else ""), end
            renderer.choose(5)
            assert np.isfinite(light(renderer.render(VIEW))).all()
        after = {key: name for key, name in stage.device.alive.items() if key not in before}
        assert not after, end


def test_what_invalidates_recordings_drops_prepared_frames_and_keeps_the_history(stage, scene):
    with opened(stage, scene) as renderer:
        for number in (7, 0, 3):
            renderer.choose(number)
            renderer.render(VIEW)
        renderer._frames.forget()
        assert renderer.render(VIEW).work["recorded"] == 1
        histories = _histories(renderer)
        renderer.choose(0)
        frame = renderer.render(VIEW)
        assert (frame.work["recorded"], frame.work["scales_prepared"], frame.work["history_resets"]) == (
            1,
            2,
            0,
        )
        assert frame.work["taa_frames"] == 5 and _histories(renderer) == histories


def test_another_size_begins_anew_at_the_scale_that_was_chosen(stage, scene):
    with opened(stage, scene) as renderer:
        renderer.choose(2)
        renderer.render(VIEW)
        renderer.resize((24, 18))
        frame = renderer.render(VIEW)
        assert frame.reset == "resize" and renderer.number == 2
        found = light(frame)
    with opened(stage, scene, size=(24, 18), first_scale=2) as renderer:
        assert np.array_equal(light(renderer.render(VIEW)), found)


def test_a_scale_without_memory_leaves_the_frame_as_it_was(stage, scene, monkeypatch):
    with opened(stage, scene) as renderer:
        before = light(renderer.render(VIEW))
        objects = len(stage.device.alive)

        def full(*_):
            raise MemoryError("no memory")

        monkeypatch.setattr(type(renderer._api), "_execute", full)
        with pytest.raises(MemoryError):
            renderer.choose(0)
        monkeypatch.undo()
        assert renderer.number == 7 and len(stage.device.alive) == objects
        frame = renderer.render(VIEW)
        assert frame.work["recorded"] == 1 and frame.work["taa_frames"] == 2  # the other slot's first frame
        assert np.abs(light(frame) - before).max() < before.max()
        renderer.choose(0)
        assert renderer.render(VIEW).work["taa_frames"] == 3


# --- who chooses ---


def test_render_never_chooses_and_pace_does(stage, scene):
    heavy = 1e4
    with opened(stage, scene, target_ms=1.0) as renderer:
        for _ in range(2 * WINDOW):
            renderer.render(VIEW)
        assert renderer.number == COUNT - 1
        for _ in range(WINDOW):
            renderer.pace(heavy)
        assert renderer.number == 0
        frame = renderer.render(VIEW)
        assert frame.work["scale_number"] == 0 and frame.work["history_resets"] == 0


def test_a_scale_that_was_chosen_is_where_the_controller_goes_on(stage, scene):
    with opened(stage, scene, target_ms=10.0) as renderer:
        renderer.choose(3)
        for _ in range(WINDOW + LATE):
            renderer.pace(9.0)
        assert renderer.number == 3


def test_the_same_calls_give_the_same_pixels(stage, scene):
    runs = []
    for _ in range(2):
        with opened(stage, scene, "color", load="step", target_ms=5.0) as renderer:
            pictures, numbers = [], []
            for n in range(100):
                renderer.pace(float(n))  # ignored: the load is a formula
                frame = renderer.render(STEP if n % 2 else VIEW)
                numbers.append(renderer.number)
                if n % 20 == 0:
                    pictures.append(light(frame))
            runs.append((numbers, np.array(pictures)))
    assert runs[0][0] == runs[1][0] and len({*runs[0][0]}) > 1
    assert np.array_equal(runs[0][1], runs[1][1])


def test_an_image_of_a_frame_before_a_change_is_gone_and_its_figures_stay(stage, scene):
    with opened(stage, scene) as renderer:
        frame = renderer.render(VIEW)
        renderer.choose(0)
        with pytest.raises(StaleFrameError, match="the scale has changed"):
            frame.image("color_linear")
        assert frame.timings.keys() >= {"taa"} and frame.work["scale_number"] == 7


# --- what is refused ---


@pytest.mark.parametrize(
    "asked",
    [
        "target_ms=0",
        "target_ms=nan",
        "target_ms=-16",
        "target_ms=inf",
        "first_scale=8",
        "load=heavy",
        "taa=off",
    ],
)
def test_values_out_of_range_are_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.split("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    "more",
    [
        {"view": "normals"},
        {"transparency": "weighted"},
        {"fog_half": True},
        {"recording_threads": 1},
        {"surfaces": "visibility"},
        {"rate_policy": "radial"},
    ],
)
def test_settings_with_room_for_one_frame_are_refused_in_one_sentence(stage, scene, more):
    ((name, _),) = more.items()
    with pytest.raises(SettingError, match=f"{name}=") as found:
        opened(stage, scene, **more)
    assert "\n" not in str(found.value)


def test_there_are_eight_scales(stage, scene):
    with opened(stage, scene) as renderer:
        for number in (-1, 8, 0.5, True):
            with pytest.raises(UserError, match="0 to 7"):
                renderer.choose(number)
    with pytest.raises(StaleFrameError, match="closed"):
        renderer.choose(0)
    assert replaced(Settings(), first_scale=3).scaling.first_scale == 3
