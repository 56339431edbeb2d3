"""The bench of temporal anti-aliasing: numbers that are known without it, and what tables and figures say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from chapters.ch11.benches import pass_times, taa, taa_scenes, taa_truth
from common.reports.benches import Effort
from common.scene.primitive import nothing
from tests.support.bench_views import drawn, shown
from tests.support.packages import BACKENDS
from tests.twins import shading
from tools.bench import bench, figures
from tools.bench.lessons import parts
from tools.bench.points import Subject

SMALL = Effort(0, 1, 1, 1, 1, everything=False)
SIZE = (48, 32)
VULKAN, GL = BACKENDS
DRIVEN = (VULKAN, pytest.param(*GL.values, marks=[*GL.marks, pytest.mark.long]))

pytestmark = pytest.mark.feature("tools/bench")


@pytest.fixture(scope="module", params=DRIVEN)
def record(request):
    """Return what a reader of the JSON gets of a quick look at small pictures."""
    device = request.getfixturevalue("vulkan_device" if request.param == "vulkan" else "gl_context")
    told = []
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"QUICK_FRAMES": 7, "SETTLED": 3, "SLOW_TIMED": 1, "SHARP_FRAMES": 2}.items():
            patch.setattr(taa, name, value)
        subject = Subject(11, request.param, nothing("bench"), SIZE, device)
        made = taa.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and 0.0 <= told[-1] < 1.0
    return json.loads(json.dumps(made, allow_nan=False))


def rows_of(record):
    return {(row["case"], row["mode"]): row for row in record["rows"]}


@pytest.mark.feature("taa/variance-clip-clamped")
def test_numbers_are_those_that_must_be(record):
    """Without a history nothing is left of an object, and a view at rest neither changes nor flickers."""
    rows = rows_of(record)
    assert len(rows) == 3 * len(taa.QUICK_MODES) == len(record["rows"])
    still, full = rows["still", taa.OFF], rows["still", taa.FULL]
    assert still["flicker"] == still["flicker_rest"] == full["flicker_rest"] == 0.0
    assert still["psnr_rest"] == still["psnr_last"] == pytest.approx(still["psnr"])
    assert still["rest"] == record["frames"] < full["rest"] < taa.MOST_FRAMES
    assert full["psnr_rest"] > still["psnr_rest"]
    passed = rows["disocclusion", taa.OFF]
    assert passed["ghost_max"] == passed["ghost_mean"] == 0.0
    assert rows["disocclusion", taa.FULL]["ghost_max"] < 2.0
    sharp, blurred = rows["edge", taa.OFF], rows["edge", taa.FULL]
    assert sharp["mtf50"] is None and sharp["sharpest"]
    assert 0.2 < blurred["mtf50"] < 0.6, "the mean over a pixel has 0.60"
    assert all(row["ghost_max"] is None for (case, _), row in rows.items() if case != "disocclusion")


def test_tables_and_figures_say_all_rows(record):
    text = shown(taa, record, 80)
    assert max(map(len, text.splitlines())) <= 120 and "dB against none" in text
    assert all(name in text for name in (*taa.QUICK_MODES, "passes", "MTF50"))
    found = dict(figures.PARTS["taa"]({"taa": record}))
    assert len(found) == len(record["rows"]) + len(record["times"])
    assert dict(figures.PARTS["taa"]({})) == {}


@pytest.mark.needs("matplotlib")
def test_a_plot_has_a_line_for_each_case(record):
    assert drawn(taa, record) == list(dict.fromkeys(row["case"] for row in record["rows"]))


def test_references_are_the_mean_of_light_behind_the_curve():
    rng = np.random.default_rng(5)
    light = rng.random((16, 24, 3)) * 3
    mean = taa_truth.box_mean(light)
    assert mean.shape == (2, 3, 3)
    assert mean[1, 2] == pytest.approx(light[8:, 16:].reshape(-1, 3).mean(axis=0), abs=1e-12)
    assert np.abs(taa_truth.tone_neutral(light) - shading.tone_neutral(light)).max() < 1e-12
    assert np.array_equal(taa_truth.shown(np.zeros((1, 3))), np.zeros((1, 3)))


def test_a_ghost_is_found_where_an_object_was():
    """A box of three columns goes to the right by one a frame, and leaves a trail that fades by half in each frame."""
    seen, without, truth, trail = [], [], [], np.zeros((4, 12))
    for frame in range(8):
        covered = np.zeros((4, 12), bool)
        covered[:, frame : frame + 3] = True
        trail = np.where(covered, 1.0, trail / 2)
        seen.append(np.repeat(trail[..., None], 3, axis=2))
        without.append(np.zeros((4, 12, 3)))
        truth.append(taa_truth.Reference(seen[-1], seen[-1], covered))
    found = taa.ghosts(seen, without, truth)
    most = [255 * 0.5**age for age in range(1, 8)]
    assert [one for one, _ in found["ghost_ages"]][:7] == pytest.approx(most)
    assert found["ghost_max"] == pytest.approx(255 / 16) == found["ghost_mean"]


def test_modes_are_the_choices_of_the_settings_and_their_names_differ():
    modes = dict(taa.MODES + taa.DEPTHLESS)
    assert len(modes) == len(taa.MODES) + len(taa.DEPTHLESS)
    subject = Subject(11, "vulkan", nothing("bench"), SIZE, None)
    known = {name: set() for name in ("constraint", "weight", "history", "velocity", "format")}
    for values in modes.values():
        chosen = taa_scenes.settings_of(subject, **values).taa
        for name, held in known.items():
            held.add(getattr(chosen, f"taa_{name}"))
    settings = subject.module("taa.settings")
    for name, choices in (("constraint", "CONSTRAINTS"), ("weight", "WEIGHTS"), ("velocity", "VELOCITIES")):
        assert known[name] == set(getattr(settings, choices))
    assert known["history"] == set(settings.HISTORIES) and len(known["format"]) == 2


def test_a_chapter_without_a_history_has_no_such_part():
    subject = Subject(10, "vulkan", nothing("bench"), (8, 8), None)
    assert taa.measure(subject, SMALL, lambda what, part: None) is None
    assert "taa" not in bench.parts_of(10, "vulkan")
    assert all("taa" in parts.parts_of(11, api) for api in ("vulkan", "gl"))


def test_times_by_the_clock_are_those_of_chapter_10s():
    """The file is a copy: benches of a chapter import nothing of another."""
    from chapters.ch10.benches import pass_times as before

    assert Path(pass_times.__file__).read_text("utf-8") == Path(before.__file__).read_text("utf-8")
