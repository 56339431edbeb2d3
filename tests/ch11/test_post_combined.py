"""All effects at once: each can be left out, and the frame is then the one that was built without it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from chapters.ch11.graph.file import graph_path
from chapters.ch11.post.tonemap import TonemapPass
from chapters.ch11.settings import Settings
from common.errors import UserError
from common.numerics.transforms import pose_looking_at
from common.settings import flat, replaced
from common.view.camera import Perspective, View
from tests.support.fog import FULL, HAZE, foggy
from tests.support.shadows import point, yard

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (48, 36)
LENS = Perspective(0.9, 0.05)
VIEWS = tuple(
    View(pose_looking_at((3.0, 2.5, 4.0), target), LENS, ev100=2.0)
    for target in ((0.0, 0.4, 0.0), (0.3, 0.4, 0.1))
)
BASE = Settings(
    **{**FULL, "fog_format": "rgba16f", "fog": False, "graph": "deferred", "background": 0.2, "ambient": 2.0}
)

PASSES = {
    "sharpen": {"sharpen": 1.0},
    "motion_blur": {"motion_blur": 1.0},
    "bloom": {"bloom": 0.4, "bloom_threshold": 0.0, "bloom_levels": 2},
    "depth_of_field": {"aperture": 0.01, "focus_distance": 2.0, "bokeh_taps": 4},
}
"""Knobs of effects, by the pass that is switched off to leave the effect out of a frame that was built with it."""

FXAA = {"fxaa": True}
LAST = {"dither": 1.0, "display_gamma": 1.4, "display_exposure": 1.5}
"""Knobs of effects within the pass of the tone curve."""

FOG = {"fog": True}
ALL = {**FOG, **FXAA, **LAST, **{name: it for knobs in PASSES.values() for name, it in knobs.items()}}
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)


def without(*names):
    """Return settings with all effects but these."""
    return replaced(BASE, **{name: value for name, value in ALL.items() if name not in names})


def two(renderer):
    """Return the pictures of two frames since a reset, between which the camera turns."""
    renderer.reset_history("test")
    return np.stack([renderer.render(view).image("color") for view in VIEWS])


def frames(chapter, settings, scene=None):
    """Return the pictures of two frames, and the names of the passes."""
    scene = foggy(LAMP, medium=HAZE) if scene is None else scene
    with chapter.open(scene, SIZE, settings) as renderer:
        return two(renderer), [step.name for step in renderer.graph.steps]


@pytest.mark.feature("demo/combined-effects")
def test_each_pass_switched_off_gives_the_frame_built_without_its_effect(chapter):
    """And switched on again the frame with all effects; that of fog is below."""
    with chapter.open(foggy(LAMP, medium=HAZE), SIZE, without("fog")) as renderer:
        together = two(renderer)
        for name, knobs in PASSES.items():
            renderer.switch_pass(name, False)
            found = two(renderer)
            built, steps = frames(chapter, without("fog", *knobs))
            assert [step.name for step in renderer.graph.steps] == steps
            assert np.array_equal(found, built) and not np.array_equal(together, built), name
            renderer.switch_pass(name, True)
        assert np.array_equal(together, two(renderer))


HISTORY = {"taa": "full", "jitter_period": 2, "taa_average": False}
ENDS = (
    {},
    {"dither": 1.0},
    {"split": "rows", "split_at": 0.2},
    {"split": "columns", "dither": 1.0, "sharpen": 1.0, "motion_blur": 0.5, "bloom": 0.4},
)
"""What the last pass does besides; the gamma of the display tells the raw part of a split view from the other one."""


@pytest.mark.feature("demo/combined-effects")
@pytest.mark.parametrize(
    ("name", "end"),
    [
        pytest.param(name, end, marks=[pytest.mark.long] * (at % 2 != own), id=f"{name}-{' '.join(end)}")
        for own, name in enumerate(("fxaa", "taa"))
        for at, end in enumerate(ENDS)
    ],
)
def test_fxaa_or_history_switched_off_gives_the_frame_opened_without_it(chapter, name, end):
    """To the bit, and with the same passes: dither and split are done by whichever pass is the last."""
    off = {"fxaa": {"fxaa": False}, "taa": {"taa": "off"}}[name]
    history = HISTORY if name == "taa" else {}
    settings = replaced(BASE, **FXAA, **history, **end, display_gamma=1.4)
    with chapter.open(yard(LAMP), SIZE, settings) as renderer:
        together = two(renderer)
        renderer.switch_pass(name, False)
        found, steps = two(renderer), [step.name for step in renderer.graph.steps]
        renderer.switch_pass(name, True)
        assert np.array_equal(together, two(renderer))
    built, wanted = frames(chapter, replaced(settings, **off), yard(LAMP))
    assert steps == wanted
    assert np.array_equal(found, built) and not np.array_equal(together, built)


@pytest.mark.feature("demo/combined-effects")
def test_a_pass_in_place_of_the_tone_curve_is_the_last_without_fxaa_too(chapter):
    """Whether FXAA is on or off when it is put in, and when it is made."""
    settings = replaced(BASE, **FXAA, dither=1.0)
    with chapter.open(yard(LAMP), SIZE, settings) as renderer:
        together = two(renderer)
        renderer.switch_pass("fxaa", False)
        last = two(renderer)
        renderer.swap_pass("tonemap", renderer.make_pass(TonemapPass))
        assert np.array_equal(last, two(renderer))
        renderer.switch_pass("fxaa", True)
        assert np.array_equal(together, two(renderer)) and not np.array_equal(together, last)


@pytest.mark.feature("demo/combined-effects")
def test_without_fog_the_frame_is_that_of_a_scene_without_a_medium(chapter):
    off, steps = frames(chapter, without("fog"))
    none, same = frames(chapter, without(), yard(LAMP))
    assert steps == same and np.array_equal(off, none)


@pytest.mark.long
@pytest.mark.feature("demo/combined-effects")
def test_dither_and_display_change_all_effects_together_and_no_pass(chapter):
    together, steps = frames(chapter, without())
    plain, same = frames(chapter, without("dither"))
    assert steps == same and 0 < np.abs(together.astype(int) - plain).max() <= 2
    assert abs(together.mean() - plain.mean()) < 0.1
    brighter, same = frames(chapter, without("display_gamma", "display_exposure"))
    assert steps == same and brighter.mean() < together.mean()


@pytest.mark.feature("demo/combined-effects")
def test_all_off_is_the_plain_frame(chapter):
    """To the bit, with the same passes, also where effects are off in ways that leave other knobs of theirs set."""
    plain, steps = frames(chapter, BASE)
    zero = {name: flat(BASE)[name] for name in ALL}
    others = {"motion_blur_taps": 4, "fxaa_steps": 3, "fxaa_contrast": 0.5, "split_at": 0.2}
    found, same = frames(chapter, replaced(replaced(without(), **zero), **{**others, "bokeh_taps": 4}))
    assert steps == same and np.array_equal(plain, found)
    assert not {"sharpen", "fxaa", "motion_blur", "motion", "motion_objects"} & set(steps)


@pytest.mark.feature("demo/combined-effects")
@pytest.mark.parametrize("view", ["normal", pytest.param("roughness", marks=pytest.mark.long)])
def test_a_view_of_a_quantity_shows_none_of_them(chapter, view):
    settings = replaced(BASE, view=view, graph="auto")
    plain, steps = frames(chapter, settings)
    effects = {**PASSES["sharpen"], **PASSES["motion_blur"], **FXAA, **LAST, "split": "rows"}
    found, same = frames(chapter, replaced(settings, **effects))
    assert steps == same and np.array_equal(plain, found)


@pytest.mark.feature("demo/combined-effects")
def test_a_graph_without_what_settings_need_is_refused_in_one_sentence(chapter, tmp_path):
    """The passes of this chapter are not in the one, and in the other the image of bloom has another name."""

    def graph(name, passes, **names):
        file = tmp_path / name
        renamed = [
            {**it, "reads": {of: names.get(to, to) for of, to in it.get("reads", {}).items()}}
            for it in passes
        ]
        file.write_text(json.dumps({"passes": renamed}), "utf-8")
        return file

    whole = json.loads(graph_path("deferred").read_text("utf-8"))["passes"]
    new = ("motion", "motion_objects", "taa", "motion_blur", "sharpen", "fxaa")
    old = [it for it in whole if it["pass"] not in new]
    older = graph("older.json", old, history_color="color_hdr", color_focused="color_bloomed")
    glow = [{**it, **({"writes": {"color_bloomed": "glow"}} if it["pass"] == "bloom" else {})} for it in old]
    renamed = graph(
        "renamed.json", glow, history_color="color_hdr", color_focused="glow", color_bloomed="glow"
    )
    for file, knobs, said in (
        (older, {"taa": "full"}, r"older\.json has no pass 'motion', which taa=full needs: add it where"),
        (renamed, {"split": "rows"}, r"renamed\.json has no image 'color_bloomed', which split=rows shows"),
    ):
        with pytest.raises(UserError, match=said):
            chapter.open(yard(LAMP), SIZE, replaced(BASE, graph=str(file), **knobs)).close()
    for file, knobs in ((older, {"split": "rows"}), (renamed, {}), (older, FXAA)):
        picture, _ = frames(chapter, replaced(BASE, graph=str(file), **knobs), yard(LAMP))
        assert picture.any()
