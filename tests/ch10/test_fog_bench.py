"""The bench of fog: what it finds is of the right size, and tables and figures say it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from chapters.ch10.benches import fog, fog_scenes, pass_times
from common.reports.benches import Effort
from common.scene import Material
from tests.support.bench_views import shown
from tests.support.fog import HAZE, VIEW, foggy
from tests.support.packages import BACKENDS
from tests.support.scenes import quad_scene
from tests.support.shadows import point, sun
from tools.bench import bench, figures
from tools.bench.lessons import parts
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)
SIZE = (48, 36)
VULKAN, GL = BACKENDS
DRIVEN = (VULKAN, pytest.param(*GL.values, marks=[*GL.marks, pytest.mark.long]))
"""A bench drives what the tests of fog draw with both, so OpenGL is measured with --long alone."""

pytestmark = pytest.mark.feature("tools/bench")


def measured(request, **patched):
    """Return what a reader of the JSON gets of a quick look; scenes of the project are a yard with a sun and a lamp."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    scene = foggy(sun((0.5, -1.0, 0.3)), point((-1.2, 3.0, 0.8)), medium=HAZE)
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Subject, "load", lambda self, name, around="none": scene)
        for name, value in (
            {
                "QUICK_GRID": (32, 18, 16),
                "GRIDS": ((16, 9, 8),),
                "SETTLED": 6,
                "QUICK_PIXELS": 40,
                "RAMP_SIZE": (80, 180),
            }
            | patched
        ).items():
            patch.setattr(fog, name, value)
        subject = Subject(10, request.param, scene, SIZE, device)
        record = fog.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and 0.0 <= told[-1] < 1.0
    return json.loads(json.dumps(record, allow_nan=False))


@pytest.fixture(scope="module", params=DRIVEN)
def haze(request):
    return measured(request)


def rows_of(record, scene):
    return {row["name"]: row for row in record["rows"] if row["scene"] == scene}


@pytest.mark.feature("fog/froxel-volume", "fog/half-resolution-apply")
def test_errors_fall_with_the_grid_and_are_larger_near_a_lamp(haze):
    behind, ahead = (rows_of(haze, scene) for scene in fog.QUICK_SCENES)
    for rows in (behind, ahead):
        assert rows["16x9x8"]["rms"] > 1.5 * rows["grid"]["rms"] > 0
        assert rows["grid"]["froxels"] == 32 * 18 * 16 and rows[fog.NONE]["froxels"] == 0
        assert rows[fog.NONE]["rms"] is None and rows[fog.NONE]["fog_ms"] == 0.0
        assert rows["rgba32f"]["mib"] == 2 * rows["grid"]["mib"] == 7 / 4 * rows["no filter"]["mib"] * 2
        assert rows["rgba32f"]["rms"] == pytest.approx(rows["grid"]["rms"], abs=2e-3)  # steps of halves
        assert rows[fog.HALF]["codes"] <= 2 and rows["grid"]["codes"] is None
        for row in rows.values():
            if row["rms"] is not None:
                assert row["median"] <= row["p95"] and abs(row["bias"]) <= row["p95"] + row["rms"]
    assert behind["grid"]["rms"] < 0.01 < ahead["grid"]["rms"]


@pytest.mark.feature("metrics/banding", "fog/temporal-filter")
def test_bands_fall_with_each_filter(haze):
    codes = {row["way"]: row["codes"] for row in haze["bands"]}
    plain, jitter, filtered, dithered = (codes[name] for name, _ in fog.WAYS)
    assert plain > 2 * jitter > 2 * filtered
    assert abs(dithered - filtered) < 0.5


@pytest.mark.needs("matplotlib")
def test_tables_and_figures_say_all_rows(haze):
    from matplotlib.figure import Figure

    text = shown(fog, haze)
    assert all(row["name"] in text and row["scene"] in text for row in haze["rows"])
    assert "single scattering" in text and "255 codes" in text
    misty = {**haze, "rows": [{**row, "scene": "atrium:fog"} for row in haze["rows"]]}
    assert "\natrium:fog: the " in shown(fog, misty), "a colon at each end is no name of a picture"
    assert ("ms by the clock" in text) == haze["clock"] != ("ms on the GPU" in text)
    axes = Figure().add_subplot()
    fog.plot(axes, haze)
    assert axes.get_legend_handles_labels()[1] == list(fog.QUICK_SCENES)
    found = dict(figures.PARTS["fog"]({"fog": haze}))
    assert len(found) == len(haze["rows"]) + len(haze["bands"])


@pytest.fixture(scope="module", params=DRIVEN)
def shadowed(request):
    two = fog.rows_of(False, True)[:2]
    few = [
        (name, values | fog.grid(size))
        for (name, values), size in zip(two, ((32, 18, 16), (16, 9, 8)), strict=True)
    ]
    patched = {
        "QUICK_SCENES": ("atrium:fog",),
        "QUICK_RAMPS": (),
        "rows_of": lambda everything, software: few,
    }
    return measured(request, **patched)


@pytest.mark.feature("fog/light-scattering")
@pytest.mark.needs("mitsuba")
def test_a_scene_with_shadows_is_held_to_cast_rays(shadowed):
    rows = rows_of(shadowed, "atrium:fog")
    assert rows["grid"]["median"] < 0.05 and rows["32x18x16"]["rms"] > rows["grid"]["rms"]


def test_without_the_package_that_casts_rays_there_are_no_errors(monkeypatch):
    def missing(scene):
        raise ImportError

    monkeypatch.setattr(fog, "RayCaster", missing)
    lit = foggy(sun((0.5, -1.0, 0.3)), medium=HAZE)
    settings = Subject(10, "vulkan", lit, SIZE, None).settings_class()
    truth = fog._truth(lit, VIEW, np.zeros(SIZE[::-1]), np.zeros((*SIZE[::-1], 3)), settings, 10)
    assert not truth.known
    found = fog._errors(np.zeros((*SIZE[::-1], 3)), truth, True)
    assert set(found.values()) == {None}
    row = {"scene": "atrium:fog", "name": "grid", "froxels": 1, "rms": None, "codes": 0}
    lines = fog.sentences({"frames": 16, "rows": [row]})
    assert "no errors" in lines[1]


def test_rows_have_names_of_their_own_and_the_larger_grid_is_for_gpus():
    for everything in (False, True):
        for software in (False, True):
            rows = fog.rows_of(everything, software)
            assert len(dict(rows)) == len(rows)
            assert all({"fog_columns", "fog_rows", "fog_slices"} <= set(values) for _, values in rows)
    larger = "x".join(map(str, fog.LARGER))
    assert larger in dict(fog.rows_of(True, False)) and larger not in dict(fog.rows_of(True, True))


def test_black_surfaces_send_no_light_and_have_no_holes():
    glowing = Material(alpha_mode="mask", emissive=(1.0, 0.0, 0.0))
    panes = quad_scene(
        materials=(Material(alpha_mode="blend"), glowing, Material(unlit=True)),
        instance_materials=(0, 1, 2),
        matrices=(np.eye(4),) * 3,
    )
    black = fog_scenes.with_black_surfaces(panes)
    assert black.instances.visible.tolist() == [False, True, True]
    assert all(one.base_color[:3] == (0.0, 0.0, 0.0) == one.emissive for one in black.materials)
    assert {one.alpha_mode for one in black.materials} == {"opaque"} and black.materials[2].unlit


def test_a_chapter_without_fog_has_no_such_part():
    subject = Subject(9, "vulkan", quad_scene(), (8, 8), None)
    assert fog.measure(subject, SMALL, lambda what, part: None) is None
    assert "fog" not in bench.parts_of(9, "vulkan")
    assert all("fog" in parts.parts_of(10, api) for api in ("vulkan", "gl"))
    assert dict(figures.PARTS["fog"]({})) == {}


def test_times_by_the_clock_are_those_of_chapter_9s():
    """The file is a copy: benches of a chapter import nothing of another."""
    from chapters.ch09.benches import pass_times as before

    assert Path(pass_times.__file__).read_text("utf-8") == Path(before.__file__).read_text("utf-8")
