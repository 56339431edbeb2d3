"""What an edit leaves in a picture that has come to rest, against a renderer that is opened after the edit."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch11.settings import Settings
from chapters.ch11.taa import model
from common.reports.sequences import flicker_between
from common.scene import Material
from tests.support.taa import FULL, VIEW, court

pytestmark = [pytest.mark.variants("vulkan", "gl"), pytest.mark.feature("taa/history")]

SIZE, PERIOD = (64, 48), 8
STEPS = 5
KNOBS = {
    "defaults": {},
    "scale": {"taa_scale": 0.67, "jitter_period": PERIOD},
    "short period": {"jitter_period": 4},
}


def pictures(chapter, scene, change=None, **knobs):
    """Return the pictures in codes until the view rests, without those of `change`, which draws and edits first."""
    settings = Settings(**{**FULL, "jitter_period": PERIOD, "color_format": "rgba16f", **knobs})
    with chapter.open(scene, SIZE, settings) as renderer:
        if change is not None:
            change(renderer)
        found = []
        while not renderer.idle(VIEW):
            assert len(found) < 500
            found.append(renderer.render(VIEW).image("color").astype(np.float64))
        return found


def moves(scene):
    """Return a function that draws frames, in each of which the bright box moves; then it stands still."""
    node = int(scene.instances.node[1])
    start = scene.nodes.matrix[node].copy()

    def change(renderer):
        for step in range(STEPS):
            with scene.edit() as edit:
                matrix = start.copy()
                matrix[:3, 3] += np.array((0.25, 0.1, 0.15)) * step
                edit.set_transform(node, matrix=matrix)
            renderer.render(VIEW)

    return change


def appears(scene):
    """Return a function that draws frames without the box, and shows it after them."""

    def change(renderer):
        for visible in (False, True):
            with scene.edit() as edit:
                edit.set_visible(1, visible)
            for _ in range(STEPS):
                renderer.render(VIEW)

    return change


SAMPLE = {("short period", moves), ("scale", appears)}


def bright():
    """Return the court with a box of a strong colour, which leaves much where it was."""
    return court(Material(base_color=(1.0, 0.9, 0.2, 1.0), emissive=(2.0, 1.5, 0.2)))


@pytest.mark.parametrize(
    ("knobs", "edits"),
    [
        pytest.param(knobs, edits, marks=[pytest.mark.long] * ((knobs, edits) not in SAMPLE))
        for knobs in KNOBS
        for edits in (moves, appears)
    ],
)
def test_an_edited_view_at_rest_is_that_of_a_renderer_opened_anew(chapter, edits, knobs):
    """Within a code of 255, at the edges of what has moved as well."""
    scene = bright()
    first = pictures(chapter, scene, **KNOBS[knobs])[-1] if edits is moves else None
    edited = pictures(chapter, scene, edits(scene), **KNOBS[knobs])[-1]
    alone = pictures(chapter, scene, **KNOBS[knobs])[-1]
    assert np.abs(edited - alone).max() <= 1
    assert first is None or np.abs(first - alone).max() > 50, "the edit is seen"


@pytest.mark.parametrize("mode", ["histogram", pytest.param("mips", marks=pytest.mark.long)])
def test_frames_are_averaged_while_the_exposure_adapts(chapter, mode):
    """Light divided by the exposure is that of a renderer opened anew, although the exposure changed in each frame."""
    scene = bright()

    def opened(**more):
        settings = Settings(**{**FULL, "jitter_period": 4, "exposure": mode, **more})
        return chapter.open(scene, SIZE, settings, outputs={"color", "color_linear"})

    with opened() as renderer:
        renderer.render(VIEW)
        lamp = scene.lights[0]
        with scene.edit() as edit:
            edit.set_light(0, replace(lamp, intensity=40.0 * lamp.intensity))
        codes, resting = [], 0
        while not renderer.techniques["taa"].resting(len(codes) / 60):
            frame = renderer.render(VIEW, (len(codes) + 1) / 60)
            codes.append(frame.image("color").astype(np.float64).mean())
            resting += renderer.techniques["hdr"].resting((len(codes) + 1) / 60)
        assert frame.work["taa_averaging"] == 1 and resting == 0, "the exposure is still on its way"
        assert abs(codes[-1] - codes[2]) > 10, "and changes the picture"
        found = frame.image("color_linear").astype(np.float64)
        time = (len(codes) + 1) / 60
        assert not renderer.idle(VIEW, time)
        while not renderer.idle(VIEW, time):
            assert time < 60
            last = renderer.render(VIEW, time)
            time += 0.5
        kept = last.image("color_linear").astype(np.float64)
        assert abs(last.image("color").mean() - codes[-1]) > 1, "the exposure went on"
    with opened(exposure="view") as renderer:
        while not renderer.idle(VIEW):
            alone = renderer.render(VIEW)
        alone = alone.image("color_linear").astype(np.float64)
    assert np.abs(found - alone).max() < 2 * model.RESIDUE * alone.max()
    assert np.abs(kept - found).max() < 1e-4 * found.max()


@pytest.mark.parametrize("more", [{"taa_format": "rgba16f"}, {"rate_policy": "sobel"}, {"taa": "off"}])
def test_what_cannot_follow_an_exposure_waits_for_it(more):
    values = {"taa": "full", **more}
    assert not model.averages_exposed(Settings(**values)) and model.averages_exposed(Settings(taa="full"))


def test_no_jump_is_seen_where_a_mean_begins(chapter):
    """Frames change no more than those of the period before, which has the constraint, and less and less in the end."""
    scene = bright()
    found = pictures(chapter, scene, moves(scene))
    changes = [flicker_between(before, after) for before, after in itertools.pairwise(found)]
    settling, means, last = changes[: PERIOD - 2], changes[PERIOD - 2 :], changes[-PERIOD:]
    assert max(means) <= max(settling)
    assert np.mean(means[:PERIOD]) <= np.mean(settling)
    assert max(last) < 0.25 * max(means)
    means_of_periods = [
        np.mean(changes[at : at + PERIOD]) for at in range(PERIOD - 2, len(changes) - PERIOD, PERIOD)
    ]
    assert all(later <= 1.02 * before for before, later in itertools.pairwise(means_of_periods))
