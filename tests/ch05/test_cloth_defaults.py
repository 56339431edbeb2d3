"""How finely cloth is cut by default: the choice, held to what was measured of error against time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from chapters.ch05.cloth.types import Steps
from chapters.ch05.settings import Settings

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "docs" / "benchmarks" / "ch05-discrete.json"
WITHIN = 0.2
"""Part of the true stretch by which that of the default may be off."""


def parts(found):
    """Return what a record says of cloth, wherever in it that stands."""
    if isinstance(found, dict) and "truth_stretch" in found:
        return found
    within = found.values() if isinstance(found, dict) else found if isinstance(found, list) else ()
    return next((made for one in within if (made := parts(one))), None)


@pytest.fixture(scope="module")
def measured():
    """Return the record, and its points of XPBD with one iteration by their number of substeps."""
    made = parts(json.loads(RECORD.read_text(encoding="utf-8")))
    points = {one["substeps"]: one for one in made["points"] if one["kind"] == "XPBD, substeps"}
    return made, points


def test_the_default_is_the_fewest_substeps_with_nearly_the_true_stretch(measured):
    made, points = measured
    fits = [count for count, one in points.items() if one["stretch"] <= (1 + WITHIN) * made["truth_stretch"]]
    settings = Settings()
    assert (settings.cloth.method, settings.cloth.substeps, settings.cloth.iterations) == (
        "xpbd",
        min(fits),
        1,
    )
    assert points[min(fits)]["rms_m"] < 0.5 * points[min(fits) // 2]["rms_m"], (
        "twice the time, a third of the error"
    )


def test_steps_are_cut_as_the_settings_cut_them():
    settings, steps = Settings(), Steps()
    assert (steps.dt, steps.substeps, steps.iterations, steps.method, steps.integrator) == (
        settings.cloth.step,
        settings.cloth.substeps,
        settings.cloth.iterations,
        settings.cloth.method,
        settings.cloth.integrator,
    )


def test_the_readme_has_the_figures_of_the_record(measured):
    made, points = measured
    text = (ROOT / "chapters" / "ch05" / "README.md").read_text(encoding="utf-8")
    for count in (Settings().cloth.substeps // 2, Settings().cloth.substeps, 32):
        one = points[count]
        wanted = f"| {count} substeps of 1 iteration | {one['gpu_ms']:.2f} "
        wanted += f"| {one['rms_m'] * 1e3:.2g} mm | {one['stretch']:.0%} |"
        assert wanted.replace("%", " %") in text
    assert f"{made['truth_stretch']:.1%}".replace("%", " %") in text
