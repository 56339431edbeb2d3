"""All effects at once: each can be left out, and the frame is then the one that was built without it."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.settings import Settings
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

EFFECTS = {
    "sharpen": ({"sharpen": 1.0}, ("sharpen",)),
    "fxaa": ({"fxaa": True}, ("fxaa",)),
    "motion blur": ({"motion_blur": 1.0}, ("motion_blur",)),
    "bloom": ({"bloom": 0.4, "bloom_threshold": 0.0, "bloom_levels": 2}, ("bloom",)),
    "depth of field": ({"aperture": 0.01, "focus_distance": 2.0, "bokeh_taps": 4}, ("depth_of_field",)),
    "fog": ({"fog": True}, ()),
    "dither": ({"dither": 1.0}, ()),
    "display": ({"display_gamma": 1.4, "display_exposure": 1.5}, ()),
}
"""Knobs of each effect, and the passes that are switched off to leave it out of a frame that was built with it."""


def scene():
    return foggy(point((-1.2, 3.0, 0.8), candela=60.0), medium=HAZE)


def knobs_of(names):
    return {name: value for effect in names for name, value in EFFECTS[effect][0].items()}


def off(names):
    """Return all knobs of effects with the values that switch them off."""
    defaults = flat(BASE)
    return {name: defaults[name] for name in knobs_of(names)}


def frames(chapter, settings, switched=(), of=None):
    """Return the pictures of two frames between which the camera turns, and the names of the passes."""
    with chapter.open(of or scene(), SIZE, settings) as opened:
        for name in switched:
            opened.switch_pass(name, False)
        pictures = [opened.render(view).image("color") for view in VIEWS]
        return np.stack(pictures), [step.name for step in opened.graph.steps]


@pytest.mark.feature("demo/combined-effects")
def test_each_effect_switched_off_gives_the_frame_built_without_it(chapter):
    """Passes are switched off in a frame that has them; other effects are knobs of a frame that was built before."""
    together, steps = frames(chapter, replaced(BASE, **knobs_of(EFFECTS)))
    for effect, (_, switched) in EFFECTS.items():
        others = [name for name in EFFECTS if name != effect]
        without, fewer = frames(chapter, replaced(BASE, **knobs_of(others)))
        assert not np.array_equal(together, without), effect
        if effect == "fog":  # the scene has no medium
            found, _ = frames(
                chapter, replaced(BASE, **knobs_of(EFFECTS)), of=yard(point((-1.2, 3.0, 0.8), candela=60.0))
            )
        elif switched and effect != "fxaa":
            found, _ = frames(chapter, replaced(BASE, **knobs_of(EFFECTS)), switched)
        else:
            found, names = frames(
                chapter, replaced(replaced(BASE, **knobs_of(EFFECTS)), **off([effect]))
            )
            assert names == fewer
        assert np.array_equal(found, without), effect


@pytest.mark.core
@pytest.mark.feature("demo/combined-effects")
def test_all_off_is_the_plain_frame(chapter):
    """To the bit, with the same passes, also where effects are off in ways that leave other knobs of theirs set."""
    plain, steps = frames(chapter, BASE)
    others = {"motion_blur_taps": 4, "fxaa_steps": 3, "fxaa_contrast": 0.5, "split_at": 0.2}
    found, same = frames(chapter, replaced(BASE, **{**off(EFFECTS), **others}))
    assert steps == same and np.array_equal(plain, found)
    assert not {"sharpen", "fxaa", "motion_blur", "motion", "motion_objects"} & set(steps)


@pytest.mark.feature("demo/combined-effects")
@pytest.mark.parametrize("view", ["normal", "roughness"])
def test_a_view_of_a_quantity_shows_none_of_them(chapter, view):
    settings = replaced(BASE, view=view, graph="auto")
    plain, steps = frames(chapter, settings)
    effects = {**knobs_of(["sharpen", "fxaa", "motion blur", "dither", "display"]), "split": "rows"}
    found, same = frames(chapter, replaced(settings, **effects))
    assert steps == same and np.array_equal(plain, found)
