"""`strata bench`: a quick one leaves a whole record; what is wrong with a wish is said before anything is measured."""

from __future__ import annotations

import json
import math
import os
import subprocess
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from chapters import scenes
from chapters.ch01.settings import Settings
from common.errors import UnsupportedError, UserError
from common.paths import ROOT
from common.scene import stability
from common.settings import Knob, flat, preset, replaced
from tools.bench import bench, prepared
from tools.bench import points as bench_points
from tools.bench.prepared import prepared_points
from tools.bench.report import FRAME_PARTS, shows
from tools.cli.commands import invoke

QUICK = ["bench", "1", "--quick", "--scene", "cornell", "--size", "64x36"]

KEYS = {
    *(
        "format",
        "chapter",
        "title",
        "parts",
        "backend",
        "device",
        "system",
        "python",
        "load_before",
        "commit",
    ),
    *("date", "scene", "size", "cache_state", "frames", "rounds", "quick", "reference", "points", "prepared"),
    *("start_s", "scales", "pipelines", "threads", "loads", "readback", "stability"),
}
"""Of a record of chapter 1; later chapters have more parts."""
KEYS_WITHIN = {
    "device": {"name", "driver", "class", "api_version"},
    "scene": {"name", "instances", "triangles"},
    "reference": {"preset", "samples_per_pixel"},
    "start_s": {"cold", "warm"},
    "stability": {"bound", "worst", "cases"},
}
POINT_KEYS = {
    *("name", "kind", "settings", "passes_ms", "error", "work", "front"),
    *("gpu_ms", "wall_ms", "cpu_ms", "noise_ms", "wall_noise_ms", "cpu_noise_ms"),
    *("least_ms", "wall_least_ms", "cpu_least_ms"),
}


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """The record of one quick bench, made through the command line."""
    path = tmp_path_factory.mktemp("bench") / "record.json"

    def small(settings_class, name):
        """Return a preset with a small environment: what is measured costs less, how it is measured is the same."""
        detail = {"low": 1.0, "medium": 0.7, "high": 0.5, "reference": 0.35}[name]
        return replaced(preset(settings_class, name), environment_size=32, environment_detail=detail)

    try:
        chapters.open(1, scene=scenes.load("cornell"), size=(4, 4)).close()
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prepared, "preset", small)
        assert invoke([*QUICK, "--json", str(path)]) == 0
    return bench.read_record(path)


@pytest.mark.feature("tools/bench")
def test_a_record_says_what_was_measured_where(record):
    assert record.keys() == KEYS
    for key, within in KEYS_WITHIN.items():
        assert record[key].keys() == within
    assert all(point.keys() == POINT_KEYS for point in record["points"])
    assert record["chapter"] == 1
    assert record["size"] == [64, 36]
    assert record["scene"]["name"] == "cornell"
    assert record["scene"]["triangles"] > 0
    assert record["backend"] == chapters.choose_backend("auto", 1)
    assert record["device"].keys() >= {"name", "driver", "class", "api_version"}
    assert all(record["device"].values())
    if (ROOT / ".git").exists() and "STRATA_COMMIT" not in os.environ:
        head = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert record["commit"].removesuffix("+") == head.stdout[:12]
    assert record["commit"]
    assert record["cache_state"]
    assert record["quick"] is True
    assert record["reference"] == {"preset": "reference", "samples_per_pixel": 4}


@pytest.mark.feature("tools/bench")
def test_a_record_of_opengl_has_the_same(gl_context, tmp_path):
    path = tmp_path / "gl.json"
    assert invoke([*QUICK, "--backend", "gl", "--only", "settings", "--json", str(path)]) == 0
    record = bench.read_record(path)
    assert record["backend"] == "gl" and record["device"]["name"] == gl_context.capabilities.device
    assert {point["name"] for point in record["points"]} >= {"low", "medium", "high", "reference"}
    assert all(point["wall_ms"] > 0 and point["work"]["draws"] > 0 for point in record["points"])
    assert all(point["error"]["relative_mse"] >= 0 for point in record["points"])


@pytest.mark.feature("tools/bench")
def test_every_setting_has_time_error_and_work(record):
    names = [point["name"] for point in record["points"]]
    assert names == ["low", "medium", "high", "reference"]  # a quick look turns no knob alone
    for point in record["points"]:
        times = [point[name] for name in ("gpu_ms", "wall_ms", "cpu_ms")]
        assert all(math.isfinite(time) and time > 0 for time in times)
        resolved = {"resolve"} if point["work"]["samples"] > 1 else set()
        assert set(point["passes_ms"]) == {"forward", "tonemap"} | resolved
        assert point["gpu_ms"] <= point["wall_ms"]
        assert point["noise_ms"] >= 0
        assert point["error"].keys() == {"relative_mse", "max_abs", "flip"}
        # One sample a pixel is never the average of many: an error of 0 would mean that nothing was compared.
        assert all(value is None or 0 < value < 1 for value in point["error"].values())
        assert point["work"]["draws"] > 0
        assert point["work"]["passes"] == 2 + len(resolved)


@pytest.mark.feature("tools/bench")
def test_what_is_made_before_the_first_frame_has_time_and_error(record):
    (swept,) = record["prepared"]
    assert [point["name"] for point in swept["points"]] == ["low", "medium", "high"]
    assert swept["truth"]["table_samples"] == 4096  # the preset reference
    for point in swept["points"]:
        assert point["parts_ms"].keys() == {
            "environment maps",
            "environment table",
        }  # nothing came from a disk
        assert point["gpu_ms"] == pytest.approx(sum(point["parts_ms"].values()))
        assert 0 < point["error"]["relative_mse"] < 1
    low, _, high = swept["points"]
    assert low["error"]["relative_mse"] > high["error"]["relative_mse"]


def test_a_sweep_turns_each_knob_alone_and_holds_it_to_more_than_any_preset():
    (swept,) = Settings.PREPARED
    found = {name: settings for name, _, settings in prepared_points(Settings, swept)}
    assert list(found)[:4] == ["low", "medium", "high", "reference"]
    assert found["table_size=16"] == Settings(table_size=16)
    assert "table_size=64" not in found  # it is the preset medium
    # Of the presets, only the knobs that are swept.
    assert found["low"].scene.anisotropy == Settings().scene.anisotropy
    for name, values in swept.knobs.items():
        better = min if name == "environment_detail" else max
        used = [flat(settings)[name] for settings in found.values()]
        assert better(swept.truth[name], *used, *values) == swept.truth[name]


def test_the_front_is_what_nothing_beats():
    points = [point("a", 1.0, 0.5), point("b", 2.0, 0.2), point("c", 3.0, 0.3), point("d", 2.0, 0.2)]
    assert [bench_points.on_front(one, points) for one in points] == [True, True, False, True]


@pytest.mark.feature("tools/bench")
def test_starts_and_stability_are_part_of_the_record(record):
    cold, warm = (record["start_s"][state] for state in ("cold", "warm"))
    for times in (cold, warm):
        parts = [times[name] for name in ("python", "import", "load", "create", "first frame")]
        assert all(part > 0 for part in parts)
        assert sum(parts) == pytest.approx(times["total"], abs=0.01)
    # OpenGL's driver compiles by itself, uncounted.
    assert (cold["shaders_compiled"] > 0) == (record["backend"] == "vulkan")
    assert warm["shaders_compiled"] == 0
    assert record["stability"]["cases"] == [record["stability"]["worst"]]
    assert record["stability"]["worst"]["pixels_changed"] <= stability.BOUND == record["stability"]["bound"]


def test_settings_are_the_presets_and_each_of_their_knobs_turned_alone():
    found = {point.name: point for point in bench_points.points(Settings)}
    assert found["low"].settings.scene.anisotropy == 1.0
    assert found["anisotropy=8"].settings == Settings(anisotropy=8.0)
    assert found["color_format=rgba32f"].settings == Settings(color_format="rgba32f")
    assert "anisotropy=4" not in found  # it is the preset medium
    assert found["msaa=4"].settings == Settings(msaa=4)
    assert "msaa=8" not in found  # not every device has it
    assert not any(name.startswith(("environment", "table")) for name in found)  # turned where there is one
    assert all(
        point.kind == ("preset" if name in Settings.PRESETS else "knob") for name, point in found.items()
    )


@pytest.mark.parametrize(
    ("presets", "swept"),
    [
        ((1, 16), [1, 2, 4, 8, 16]),
        ((1, 2, 5), [1, 2, 4, 5]),
        ((3, 12, 6), [3, 6, 12]),
        ((0, 1, 4), [0, 1, 2, 4]),
        ((0.5, 3.0), [0.5, 1.0, 2.0, 3.0]),
        ((7, 7), [7]),
        ((0, 0), [0]),
    ],
)
def test_a_knob_is_doubled_from_its_least_preset_to_its_largest_and_no_value_comes_twice(presets, swept):
    knob = Knob(presets[0], "a knob")
    found = list(bench_points._values("knob", knob, {str(n): {"knob": v} for n, v in enumerate(presets)}))
    assert found == swept and all(a < b for a, b in pairwise(found))


def test_a_supersampled_picture_is_the_mean_of_its_samples():
    fine = np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)
    expected = [[fine[:2, :2].mean(axis=(0, 1)), fine[:2, 2:].mean(axis=(0, 1))]]
    assert np.array_equal(bench_points._averaged(fine, 2), np.float32(expected))


@pytest.mark.parametrize(
    ("shows", "waiting", "idle_after", "drawn"),
    [
        ([1, 2, 3, 3, 3, 9], [], None, 5),  # nobody says so, and it is the same three times
        ([1, 1, 2, 2, 2, 9], [], None, 5),
        ([1, 1, 1, 2, 2, 2, 9], [1, 2], None, 6),  # a texture was still to come
        ([1, 2, 3, 4], [], 2, 2),  # the renderer says so
        (list(range(100)), [], None, 65),  # it never ends
    ],
)
def test_a_picture_is_settled_when_the_renderer_or_the_picture_says_so(shows, waiting, idle_after, drawn):
    frames = []

    class Renderer:
        def render(self, view):
            frames.append(len(frames))
            work = {"textures_waiting": int(frames[-1] in waiting)}
            return SimpleNamespace(image=lambda name, n=frames[-1]: np.float32([shows[n]]), work=work)

        def idle(self, view):
            return len(frames) == idle_after

    last = bench_points.settled(Renderer(), None)
    assert len(frames) == drawn and last.image("color_linear")[0] == shows[drawn - 1]


def point(name, gpu_ms, error, noise_ms=0.1):
    """Return a preset's point of a record."""
    errors = {"relative_mse": error, "max_abs": 1.0, "flip": error}
    return {"name": name, "kind": "preset", "gpu_ms": gpu_ms, "noise_ms": noise_ms, "error": errors}


@pytest.mark.feature("tools/presets")
@pytest.mark.parametrize(
    ("others", "found"),
    [
        ([point("b", 5.0, 0.1)], [("a", "b")]),  # faster and truer
        ([point("b", 9.9, 0.1)], []),  # faster by less than both noises
        ([point("b", 5.0, 0.199)], []),  # truer by less than what a format's last bit does
        ([point("b", 5.0, 0.3)], []),  # faster, less true
        ([point("b", 20.0, 0.1)], []),  # truer, slower
        ([point("b", 5.0, 0.1, noise_ms=6.0)], []),  # too noisy to say
    ],
)
def test_a_preset_is_dominated_only_beyond_the_noise(others, found):
    assert bench_points.dominated([point("a", 10.0, 0.2), *others]) == found


@pytest.mark.feature("tools/presets")
def test_a_preset_that_costs_more_and_shows_less_is_named():
    points = [point("low", 5.0, 0.1), point("high", 10.0, 0.2), point("reference", 20.0, 0.01)]
    assert bench_points.dominated(points) == [("high", "low")]
    del points[1]
    assert bench_points.dominated(points) == []


@pytest.mark.feature("tools/bench")
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"json_path": Path("/nowhere/at/all.json")}, "folder that exists"),
        ({"plot_path": Path("/nowhere/at/all.png")}, "folder that exists"),
        ({"record": True, "quick": True}, "--quick"),
        ({"json_path": Path("a.png"), "plot_path": Path("a.png")}, "two files"),
        ({"plot_path": Path("a.txt")}, "write one of .png"),
        ({"backend": "metal"}, "no backend"),
        ({"scene": "atriun", "quick": True}, "atrium"),
    ],
)
def test_a_wrong_wish_is_one_sentence_and_nothing_is_measured(options, said, monkeypatch):
    monkeypatch.setattr(bench_points, "sweep", lambda *_: pytest.fail("it was measured"))
    with pytest.raises((UserError, UnsupportedError), match=said):
        bench.run(1, **options)


def test_a_dash_prints_the_record(record, monkeypatch, capsys):
    monkeypatch.setattr(bench, "measure", lambda *_: dict(record))
    assert invoke(["bench", "1", "--quick", "--json", "-"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out) == record
    assert "FLIP" in printed.err
    assert not Path("-").exists()


def test_one_round_is_no_verdict(record, capsys):
    presets = [point(name, 1.0 + n, 0.1 + n) for n, name in enumerate("ab")]
    for one in presets:
        one |= {"wall_ms": 1.0, "front": False}
    for rounds, said in ((1, "may be noise"), (3, "b is slower and less true than a")):
        bench.show({**record, "rounds": rounds, "points": presets, "prepared": []})
        assert said in capsys.readouterr().out


def test_a_record_of_another_format_is_refused(tmp_path):
    path = tmp_path / "old.json"
    for text in (json.dumps({"format": 0}), "{", "[]"):
        path.write_text(text)
        with pytest.raises(UserError, match="record"):
            bench.read_record(path)
    with pytest.raises(UserError, match="no record"):
        bench.read_record(tmp_path / "none.json")


def test_a_plot_is_made_where_matplotlib_is(record, tmp_path):
    if not bench.can_plot():
        with pytest.raises(UserError, match="matplotlib"):
            bench.run(1, plot_path=tmp_path / "plot.png")
        return
    bench.plot(tmp_path / "plot.png", record)
    assert (tmp_path / "plot.png").stat().st_size > 1000


def test_every_part_with_a_panel_can_be_drawn():
    parts = bench.DRAWN & set(FRAME_PARTS)
    assert "surfaces" in parts and [part for part in parts if not hasattr(shows(part), "plot")] == []


def test_the_tables_show_every_setting(record, capsys):
    bench.show(record)
    shown = capsys.readouterr().out
    for word in (*(point["name"] for point in record["points"]), "FLIP", "cold", "Stability"):
        assert word in shown
