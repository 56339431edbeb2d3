"""`strata bench --all`: every chapter and backend has its row, what fails is named, and the others go on."""

from __future__ import annotations

import json
from dataclasses import make_dataclass
from pathlib import Path

import pytest

import chapters
from common.errors import UnsupportedError, UserError
from tests.cli.test_bench_compare import DEVICE, made, point
from tools.bench import all_chapters, bench, points

BARE = make_dataclass("Settings", [])()


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Let benches be records built by hand; return a list of what each was asked for, and a set of those that fail."""
    asked, failing = [], set()
    monkeypatch.setattr(bench, "FOLDER", tmp_path / "kept")
    monkeypatch.setattr(bench, "can_plot", lambda: False)

    def one(wanted):
        asked.append(wanted)
        if (wanted["which"], wanted["backend"]) in failing:
            return "the device was lost."
        return made(point(), chapter=wanted["which"], backend=wanted["backend"])

    monkeypatch.setattr(all_chapters, "one", one)
    monkeypatch.setattr(all_chapters, "probe", lambda api: ("software", api))
    return asked, failing


@pytest.mark.feature("tools/bench")
def test_every_chapter_is_measured_on_every_backend(strata, measured):
    asked, _ = measured
    code, printed, _ = strata("bench", "--all", "--quick", "--json", "all.json")
    assert code == 0
    wanted = {(number, api) for number in chapters.available() for api in ("vulkan", "gl")}
    assert {(one["which"], one["backend"]) for one in asked} == wanted
    assert all(one["size"] == all_chapters.SIZE and one["quick"] for one in asked)
    rows = [line.split() for line in printed.splitlines()]
    for number, api in wanted:
        (row,) = [row for row in rows if row[:2] == [str(number), all_chapters.NAMES[api]]]
        assert row[2:] == ["10.00", "0.10", "1.00", "0.0700", "470", "-", "0"]
    found = json.loads(Path("all.json").read_text("utf-8"))
    assert found.keys() == {"format", "kind", "date", "commit", "quick", "records", "failures"}
    assert len(found["records"]) == len(wanted) and found["failures"] == []
    assert strata("bench", "--compare", "all.json", "all.json")[0] == 0


@pytest.mark.feature("tools/bench")
def test_one_that_fails_is_named_and_the_others_go_on(strata, measured):
    asked, failing = measured
    failing.add((2, "gl"))
    code, printed, said = strata("bench", "--all", "--quick", "--json", "-")
    found = json.loads(printed)
    assert code == 1
    assert "The bench of chapter 2 on OpenGL failed: the device was lost." in said
    assert found["failures"] == [{"chapter": 2, "backend": "gl", "why": "the device was lost."}]
    assert len(found["records"]) == len(asked) - 1 == 2 * len(chapters.available()) - 1


def test_a_backend_that_is_not_here_is_said_and_is_no_failure(strata, measured, monkeypatch):
    def probe(api):
        if api == "gl":
            raise UnsupportedError("There is no OpenGL 4.5.")
        return "software", api

    monkeypatch.setattr(all_chapters, "probe", probe)
    code, _, said = strata("bench", "--all", "--quick")
    assert code == 0 and "OpenGL is not measured: There is no OpenGL 4.5." in said
    assert {one["backend"] for one in measured[0]} == {"vulkan"}


def test_parts_are_measured_where_chapters_have_them(strata, measured):
    code, printed, said = strata("bench", "--all", "--quick", "--only", "pacing")
    assert code == 0 and "Chapter 5" in printed
    assert [(one["which"], one["backend"]) for one in measured[0]] == [
        (number, "vulkan") for number in chapters.available() if number >= 5
    ]
    assert "chapter 4 on Vulkan" in said and "chapter 5 on OpenGL" in said


def test_records_are_kept_on_one_backend_each_under_its_device(strata, measured, tmp_path):
    assert strata("bench", "--all", "--record")[0] == 0
    assert len(measured[0]) == len(chapters.available())
    names = sorted(path.name for path in (tmp_path / "kept").iterdir())
    assert names == [f"{chapters.folder_name(number)}-discrete.json" for number in chapters.available()]
    assert all(one["size"] == (640, 360) and not one["quick"] for one in measured[0])


@pytest.mark.feature("tools/bench")
def test_a_device_does_not_take_the_place_of_another_of_its_class(monkeypatch, tmp_path):
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    first, second = made(), made(device={**DEVICE, "name": "NVIDIA GeForce RTX 4090"})
    paths = []
    for one in (first, second, first, second):
        paths.append(bench.path_of(one).name)
        bench.write_record(bench.path_of(one), one)
    assert paths == ["ch01-discrete.json", "ch01-discrete-nvidia-geforce-rtx-4090.json"] * 2
    old, new = (
        made(device={**DEVICE, "name": f"llvmpipe (LLVM {version})", "class": "software"})
        for version in (15, 19)
    )
    bench.write_record(bench.path_of(old), old)
    assert bench.path_of(new) == bench.path_of(old)  # a driver's next version is the same device


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "Name the chapter"),
        ("--quick", "Name the chapter"),
        ("1 --all", "leave out 1"),
        ("--all --plot a.png", "leave out --plot"),
        ("--all --quick --record", "--quick"),
        ("--all --record --only settings", "--only"),
        ("--all --only nothing", "no such part"),
        ("--all --scene atriun", "atrium"),
        ("--all --size 12", "--size"),
        ("--all --backend metal", "no backend"),
        ("--all --json no/such/folder.json", "folder that exists"),
        ("--all --backend gl --only pacing", "no chapter has that on OpenGL"),
        ("--compare a.json", "--compare"),
    ],
)
def test_a_wrong_wish_is_one_sentence_and_nothing_is_measured(strata, measured, words, said):
    code, printed, complaint = strata("bench", *words.split())
    assert (code, printed, measured[0]) == (2, "", [])
    assert said in complaint and complaint.count("\n") == 1


# --- the process of one bench -----------------------------------------------------------------------------------------


def test_a_process_says_why_it_failed(monkeypatch):
    asked = {
        "which": 1,
        "backend": "vulkan",
        "scene": "cornell",
        "size": (0, 0),
        "quick": True,
        "parts": ["settings"],
    }
    for program, why in (
        ("import sys; print('a warning\\nno such thing.', file=sys.stderr); sys.exit(3)", "no such thing."),
        ("raise RuntimeError('odd')", "exit code 1; the last line it wrote is: RuntimeError: odd"),
        ("import os; os.abort()", "its process ended with"),
        ("", "its process ended with exit code 0"),  # it left no record
    ):
        monkeypatch.setattr(all_chapters, "COMMAND", ["-c", program])
        said = all_chapters.one(asked)
        assert why in said and (why == said) == (why == "no such thing.")


def test_what_a_bench_raises_is_one_line_of_its_process(monkeypatch, capsys, tmp_path):
    def broken(**asked):
        raise UserError("there is\nno such thing.")

    monkeypatch.setattr(bench, "measure", broken)
    asked = {"which": 1, "size": [4, 4], "quick": True, "path": str(tmp_path / "record.json")}
    monkeypatch.setattr("sys.argv", ["bench_all", json.dumps(asked)])
    assert all_chapters.main() == all_chapters.FAILED
    assert capsys.readouterr().err == "there is no such thing.\n"


def test_a_brief_record_says_how_noisy_its_times_are():
    frames = [{"gpu": gpu, "wall": gpu + 1, "cpu": 1.0, "forward": gpu} for gpu in (4.0, 5.0, 6.0, 9.0)]
    few = points.Point("medium", "preset", BARE, rounds=[frames[:2], frames[2:]])
    assert (few.record({})["noise_ms"], few.record({})["least_ms"]) == (1.0, 4.0)  # quartiles 4.75 and 6.75
    many = points.Point("medium", "preset", BARE, rounds=[[frames[0]], [frames[1]], [frames[3]]])
    assert (many.record({})["noise_ms"], many.record({})["wall_noise_ms"]) == (1.25, 1.25)  # 4.5 and 7
