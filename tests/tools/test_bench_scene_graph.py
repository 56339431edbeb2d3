"""The program docs/benchmarks/scene_graph.py: it runs, and its numbers are milliseconds of what their names say."""

from __future__ import annotations

import importlib.util
import json
import math
import sys
import time

import pytest

from common.paths import ROOT

FOLDER = ROOT / "docs" / "benchmarks"
COUNTS = [100, 5000]


@pytest.fixture
def program(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])  # the program puts the root of the clone in front
    monkeypatch.setenv("STRATA_COMMIT", "0123456789ab")
    spec = importlib.util.spec_from_file_location("bench_scene_graph", FOLDER / "scene_graph.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.feature("scene/object-graph-baseline")
def test_every_row_has_the_times_of_its_number_of_nodes(program, tmp_path, capsys):
    began = time.perf_counter()
    program.main(str(tmp_path / "a.json"), COUNTS)
    wall_ms = (time.perf_counter() - began) * 1e3
    record = json.loads((tmp_path / "a.json").read_text("utf-8"))
    stored = json.loads((FOLDER / "scene-graph.json").read_text("utf-8"))
    assert record.keys() == stored.keys() and record["commit"] == "0123456789ab"
    rows = record["sizes"]
    assert [row["nodes"] for row in rows] == COUNTS
    total_ms = 0.0
    for row in rows:
        assert row.keys() == stored["sizes"][0].keys()
        # The height of a random recursive tree is e ln n in the limit, and less before (B. Pittel 1994).
        assert math.log(row["nodes"]) < row["levels"] < math.e * math.log(row["nodes"])
        times = {name: ms for name, ms in row.items() if name.endswith("_ms") and name != "first_edit_ms"}
        assert all(ms > 0 for ms in times.values())
        total_ms += sum(times.values())
    # Of seven rounds four take the median or longer; and the rest of the program is no hundred times as long.
    assert 4 * total_ms < wall_ms < 100 * total_ms
    small, large = rows
    assert large["objects_update_ms"] > 5 * small["objects_update_ms"], "fifty times as many nodes"
    for less, more in (
        ("arrays_update_ten_leaves_ms", "arrays_update_all_ms"),
        ("arrays_from_parents_ms", "arrays_add_one_by_one_ms"),
        ("pose_after_edit_ms", "pose_whole_ms"),
        ("pose_of_clip_ms", "pose_of_clip_whole_ms"),
    ):
        assert 3 * large[less] < large[more], less  # measured: a tenth and less
    words = capsys.readouterr().out.split()
    printed = dict(zip(words[-2 * len(large) :: 2], words[1 - 2 * len(large) :: 2], strict=True))
    assert {name: float(text.replace(",", "")) for name, text in printed.items()} == pytest.approx(
        large, abs=1e-3
    )
