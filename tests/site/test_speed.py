"""The page on speed: devices stand side by side, each figure under its own, and each record with where it is from."""

from __future__ import annotations

import json

import pytest

import chapters
from tools.bench import bench
from tools.site import tables as site_tables
from tools.site.draft import Draft

SOFTWARE = {"name": "llvmpipe (LLVM 15.0.6, 256 bits)", "driver": "Mesa 25", "class": "software"}
CARD = {"name": "NVIDIA H200", "driver": "NVIDIA 580", "class": "discrete"}


def record(number, device, gpu, **more):
    """Return what the page reads of a record with one preset."""
    error = {"relative_mse": 0.1, "max_abs": 0.5, "flip": 0.0414}
    times = {"gpu_ms": gpu, "noise_ms": 0.25, "wall_ms": gpu + 1, "cpu_ms": 1.5}
    medium = {"name": "medium", "kind": "preset", "settings": {}, "error": error, "work": {}, **times}
    return {
        "format": bench.FORMAT,
        "chapter": number,
        "device": device,
        "commit": f"{number}123456789abcdef",
        "date": f"2026-0{number}-02T03:04:05",
        "size": [640, 360],
        "points": [medium],
        "start_s": {"cold": {"total": 4 * gpu}, "warm": {"total": gpu}},
        **more,
    }


@pytest.fixture
def tables(monkeypatch, tmp_path):
    """Return the rows of both tables as cells, and what the page lacks: tables(records)."""
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    monkeypatch.setattr(chapters, "available", lambda: (1, 2))
    draft = Draft((1, 2))
    monkeypatch.setattr(draft, "file", lambda path, page: path)

    def made(*records):
        for one in records:
            name = f"{chapters.folder_name(one['chapter'])}-{one['device']['class']}.json"
            (tmp_path / name).write_text(json.dumps(one), "utf-8")
        texts = [table(draft, "speed.md") for table in (site_tables.speed_table, site_tables.starts_table)]
        cells = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for text in texts
            for line in text.splitlines()
            if line.startswith("|") and not line.startswith(("|-", "| -"))
        ]
        return cells, draft.lacks

    return made


@pytest.mark.feature("tools/site")
def test_devices_stand_side_by_side_with_date_driver_and_commit(tables):
    cells, lacks = tables(record(1, CARD, 3.0), record(1, SOFTWARE, 200.0), record(2, CARD, 2.0))
    heads, first, second, origins, of_first, of_second, starts, cold, cold_second = cells
    assert heads[2] == "llvmpipe: GPU, ms" and heads[6] == "NVIDIA H200: GPU, ms"
    assert first == [
        "1",
        "medium",
        *("200 ± 0.250", "201", "1.50", "0.041"),
        *("3.00 ± 0.250", "4.00", "1.50", "0.041"),
    ]
    assert second == ["2", "medium", *("-",) * 4, *("2.00 ± 0.250", "3.00", "1.50", "0.041")]
    assert origins == ["chapter", "llvmpipe", "NVIDIA H200"]
    for cell, words in (
        (of_first[1], ("2026-01-02", "Mesa 25", "commit 1123456789ab", "640x360", "ch01-software.json")),
        (of_first[2], ("2026-01-02", "NVIDIA 580", "commit 1123456789ab", "ch01-discrete.json")),
        (of_second[2], ("2026-02-02", "NVIDIA 580", "commit 2123456789ab", "ch02-discrete.json")),
    ):
        assert all(word in cell for word in words)
    assert of_second[1] == "-"
    assert starts[1:] == [
        f"{device}: {state}, s" for device in ("llvmpipe", "NVIDIA H200") for state in ("cold", "warm")
    ]
    assert cold == ["1", "800.00", "200.00", "12.00", "3.00"] and cold_second == [
        "2",
        "-",
        "-",
        "8.00",
        "2.00",
    ]
    assert lacks == []


def test_a_chapter_without_a_record_is_said(tables):
    cells, lacks = tables(record(1, CARD, 3.0))
    assert [row[0] for row in cells] == ["chapter", "1", "chapter", "1", "2", "chapter", "1"]
    assert lacks == ["speed.md: measurements of chapter 2: `./strata bench 2 --record`."]


def test_without_any_record_the_page_says_so(tables):
    cells, lacks = tables()
    assert cells == []
    assert [text.partition(": ")[2].partition(":")[0] for text in lacks] == [
        "measurements of chapter 1",
        "measurements of chapter 2",
        "times of starts",
    ]
