"""The bench of exposure and bloom: its truths against the twins, and what it finds, on both backends."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from rich.console import Console

from chapters.ch07.benches import hdr
from chapters.ch07.benches import hdr_truth as truth
from common.reports.benches import Effort
from tests.support.scenes import quad_scene
from tests.twins import hdr as twins
from tools.bench import figures
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)
HALF_STEP = 2.0**-10 / math.log(2.0)
"""Stops by which a value may be rounded to half precision, up or down: at most a whole step of it."""


def test_the_average_of_a_sort_is_the_twins():
    rng = np.random.default_rng(3)
    for count in (1, 7, 1000):
        nits = 10.0 ** rng.uniform(-4, 5, count)
        for low, high in ((0.0, 1.0), (0.5, 0.95), (0.1, 0.105)):
            assert truth.log2_average(nits, low, high) == pytest.approx(
                twins.log_average(nits, low, high), abs=1e-9
            )
    assert truth.log2_average(np.zeros(3), 0.0, 1.0) == -16.0, "black counts as the darkest bin"


@pytest.mark.parametrize("levels", [1, 3, 6])
def test_bloom_is_the_twins(levels):
    picture = 10.0 ** np.random.default_rng(levels).uniform(-2, 2, (23, 38, 3))
    wanted = twins.bloomed(picture, 0.5, 1.0, levels)
    np.testing.assert_allclose(truth.bloomed(picture, 0.5, 1.0, levels), wanted, rtol=1e-12)


@pytest.mark.parametrize(("before", "after"), [(10.0, 2560.0), (2560.0, 10.0), (1.0, 1.005)])
def test_the_closed_forms_count_frames_as_a_simulation_does(before, after):
    def frames(update, exposure):
        count, state = 0, before
        while abs(exposure(state) / exposure(after) - 1.0) > 0.01:
            count, state = count + 1, update(state)
        return count

    by_stops = frames(lambda it: after * (it / after) ** math.exp(-0.1 / 0.7), lambda it: 1 / it)
    assert truth.frames_by_histogram(math.log2(before / after), 0.7, 0.1, 0.01) == by_stops
    by_nits = frames(lambda it: after + (it - after) * 0.98 ** (0.2 * 100.0), lambda it: 1 / it)
    assert truth.frames_by_mips(before, after, 0.2, 0.1, 0.01) == by_nits


@pytest.fixture(scope="module", params=["vulkan", "gl"])
def record(request):
    """Return what a reader of the JSON gets, of the picture of lamps alone."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    subject = Subject(7, request.param, quad_scene(), (8, 8), device)
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdr, "EXPOSED", ())
        patch.setattr(hdr, "QUICK_SIZE", (64, 36))
        patch.setattr(hdr, "QUICK_TIMED", ((64, 36),))
        patch.setattr(hdr, "QUICK_LEVELS", (1, 3))
        patch.setattr(hdr, "QUICK_STEPS", ((60.0, 10.0),))
        measured = hdr.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and told[-1] < 1.0
    return json.loads(json.dumps(measured, allow_nan=False))


@pytest.mark.feature("hdr/luminance-mips", "hdr/light-adaptation", "tools/bench")
def test_exposures_are_those_of_the_truth(record):
    """In 32 bits to what bins and sums round; in half precision to a step more."""
    found = {(row["way"], row["format"]): abs(row["error_stops"]) for row in record["exposures"]}
    assert set(found) == {(way, it) for way in hdr.WAYS for it in hdr.FORMATS}
    bins = 36 / 256  # a part of a bin counts at the mean of the bin
    for (way, color_format), error in found.items():
        assert error < (bins / 10 if way == "histogram" else 1e-5) + (
            HALF_STEP if color_format == "rgba16f" else 0.0
        )
    for row in record["adaptation"]:
        assert row["error_stops"] < 36 / 256 / 256
        assert abs(row["frames"] - row["closed_frames"]) <= 1 < row["frames"], (
            "that error may decide one frame"
        )


@pytest.mark.feature("hdr/bloom", "tools/bench")
def test_bloom_is_that_of_the_truth(record):
    """In 32 bits to some roundings; in half precision to those of as many stores as there are levels, up and down."""
    for row in record["bloom"]:
        stores = 1 + 2 * row["levels"]
        bound = 1e-5 if row["format"] == "rgba32f" else stores * 2.0**-10
        assert row["mean_error"] < bound and row["largest_error"] < bound
        assert (row["mean_error"] > 1e-5) == (row["format"] == "rgba16f")
    shifts = [row["shift"] for row in record["bloom"] if row["format"] == "rgba32f"]
    assert 0.0 < shifts[1] < shifts[0] < 0.5, "wider pyramids move less"


def test_the_table_and_the_figures_say_all_of_it(record):
    console = Console(file=io.StringIO(), width=140)
    hdr.show(record, console)
    text = console.file.getvalue()
    assert all(
        word in text for word in (*hdr.WAYS, *hdr.FORMATS, *hdr.PASSES, "closed form", "stops", "by a pixel")
    )
    rows = dict(figures.PARTS["hdr"]({"hdr": record}))
    assert len(rows) == sum(len(record[part]) for part in ("exposures", "adaptation", "bloom", "passes"))
    assert {row["pass"] for row in record["passes"]} == set(hdr.PASSES)
    assert dict(figures.PARTS["hdr"]({})) == {}


def test_a_chapter_without_the_setting_has_no_such_part():
    subject = Subject(6, "vulkan", quad_scene(), (8, 8), None)
    assert hdr.measure(subject, SMALL, lambda what, part: None) is None
