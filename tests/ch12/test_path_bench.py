"""The bench of paths: its errors and slopes on pictures whose noise is known, what is left out, and what it says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from chapters.ch12.benches import paths, paths_results, paths_scenes
from common.reports.benches import Effort
from common.scene.primitive import nothing
from tests.support.bench_views import drawn, shown
from tools.bench import bench, figures
from tools.bench.lessons import parts
from tools.bench.points import Subject

SMALL = Effort(0, 1, 1, 1, 1, everything=False)

pytestmark = pytest.mark.feature("tools/bench")


BOTH = [
    pytest.param("vulkan", marks=pytest.mark.long),
    pytest.param("gl", marks=[pytest.mark.needs("moderngl", "glcontext"), pytest.mark.long]),
]
"""A cold driver takes ten to twenty seconds for the kernels of all ways."""


@pytest.fixture(scope="module", params=BOTH)
def record(request):
    """Return what a reader of the JSON gets of a quick look at few paths, where Mitsuba cannot be started."""
    device = request.getfixturevalue("vulkan_device" if request.param == "vulkan" else "gl_context")
    told = []

    def refused(variant, *_):
        raise ImportError(f"no {variant} here.\nMore lines.")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paths, "QUICK_PICTURES", 3)
        patch.setattr(paths, "QUICK_SAMPLES", 16)
        patch.setattr(paths_scenes, "timed_mitsuba", refused)
        subject = Subject(12, request.param, nothing("bench"), (48, 32), device)
        made = paths.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and 0.0 <= told[-1] < 1.0
    return json.loads(json.dumps(made, allow_nan=False))


def test_errors_fall_with_the_number_of_paths(record):
    rows = {(row["sequence"], row["samples"]): row["error"] for row in record["errors"]}
    assert list(rows) == [(name, 4 << step) for name in ("pcg", "sobol") for step in range(3)]
    assert all(0.0 < rows[name, 16] < rows[name, 4] for name in ("pcg", "sobol"))
    assert set(record["slopes"]) == {"pcg", "sobol"} and max(record["slopes"].values()) < 0.0


def test_what_does_not_run_is_left_out_in_a_sentence(record):
    assert record["missing"] == [f"Mitsuba's {name}: no {name} here" for name in paths.VARIANTS]
    (row,) = record["speeds"]
    assert row["mpaths"] == pytest.approx(1e-3 * 32 * 18 * 4 / row["ms"], rel=0.5) and row["noise"] > 0.0
    assert "Left out: Mitsuba's scalar_rgb: no scalar_rgb here." in shown(paths, record, 80)


def test_tables_and_figures_say_all_rows(record):
    text = shown(paths, record, 80).partition("Left out")[0]
    assert max(map(len, text.splitlines())) <= 80
    assert all(f"{row['error']:.2e}" in text for row in record["errors"])
    rows = dict(figures.PARTS["paths"]({"paths": record}))
    assert len(rows) == len(record["errors"]) + len(record["speeds"])
    assert dict(figures.PARTS["paths"]({})) == {}


@pytest.mark.needs("matplotlib")
def test_a_plot_has_a_line_for_each_sequence(record):
    assert drawn(paths, record) == ["pcg", "sobol"]


# --- what is known without a device -----------------------------------------------------------------------------------


def noisy(slope, count=16, samples=11, seed=3):
    """Return (K, N, 16, 16, 3) means of 4, 8, 16 ... normal numbers around 2, whose errors have a slope."""
    rng = np.random.default_rng(seed)
    sums, pictures = np.zeros((count, 16, 16, 3)), []
    total = 0
    for step in range(samples):
        more = (4 << step) - total
        sums += rng.normal(0.0, np.sqrt(more), sums.shape)
        total += more
        pictures.append(2.0 + sums / total * total ** (slope + 0.5))
    return np.stack(pictures, axis=1)


@pytest.mark.parametrize("slope", [-0.5, -0.9])
def test_errors_and_slopes_of_known_noise(slope):
    samples = [4 << step for step in range(11)]
    errors = paths.relative_errors(noisy(slope))
    assert errors == pytest.approx([0.5 * n**slope for n in samples], rel=0.04)
    assert paths_results.slope_of(samples, errors) == pytest.approx(slope, abs=0.01)


def test_a_picture_that_is_wrong_by_a_constant_has_no_slope():
    """Errors that stay are seen: every other picture is brighter by a third."""
    pictures = noisy(-0.5)
    pictures[::2] += 0.6
    assert (
        abs(paths_results.slope_of([4 << step for step in range(11)], paths.relative_errors(pictures))) < 0.2
    )
    assert paths_results.slope_of([4, 8], [0.1, 0.0]) == 0.0


def test_times_for_an_error_follow_speed_and_variance():
    """Twice the time of a picture, and half its noise: half the time for the same error."""
    other = {"scene": "s", "by": "scalar_rgb", "mpaths": 2.0, "ms": 10.0, "noise": 0.2, "light": 1.0}
    row = {"scene": "s", "by": "query", "mpaths": 1.0, "ms": 20.0, "noise": 0.1, "light": 1.01}
    made = {"missing": [], "slopes": {}, "errors": [], "speeds": [row, other]}
    assert paths_results.sentences(made) == [
        "s, query: 0.50x the paths a second of Mitsuba's scalar_rgb, and 0.50x its time for the same error; "
        "the mean light is 1.010x."
    ]


@pytest.mark.needs("mitsuba")
def test_mitsuba_draws_the_metals_of_a_scene():
    """In a process of its own; where its compiler ends that, an ImportError says so."""
    subject = Subject(12, "auto", nothing("bench"), (8, 8), None)
    scene = paths_scenes.of_metal(subject.load("cornell"))
    view = paths_scenes.geometry_of(scene, "cornell").view
    row = paths_scenes.timed_mitsuba("scalar_rgb", scene, view, (16, 9), 2, 4, 16)
    assert row["light"] > 0.0 and row["noise"] > 0.0 and row["least_ms"] <= row["ms"]
    with pytest.raises(ImportError):
        paths_scenes.timed_mitsuba("no_such_variant", scene, view, (16, 9), 2, 4, 16)


def test_a_chapter_without_paths_has_no_such_part():
    subject = Subject(11, "vulkan", nothing("bench"), (8, 8), None)
    assert paths.measure(subject, SMALL, lambda what, part: None) is None
    assert "paths" not in bench.parts_of(11, "vulkan")
    assert all("paths" in parts.parts_of(12, api) for api in ("vulkan", "gl"))
