"""The bench of transparency: the error of each way against sorted layers, measured on both backends."""

from __future__ import annotations

import io
import json

import pytest
from rich.console import Console

from chapters.ch07.benches import transparency
from common.reports.benches import Effort
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)


@pytest.fixture(scope="module", params=["vulkan", "gl"])
def record(request):
    """Return what a reader of the JSON gets."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    subject = Subject(7, request.param, transparency.crossing(1), (8, 8), device)
    told = []
    measured = transparency.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and told[-1] < 1.0
    return json.loads(json.dumps(measured, allow_nan=False))


@pytest.mark.feature("oit/alternatives", "tools/bench")
def test_every_way_has_its_time_and_its_error(record):
    rows = {row["way"]: row for row in record["rows"]}
    assert list(rows) == list(transparency.WAYS)
    assert all(row["layers"] > 0 and not row["overflow"] and row["ms"] >= 0 for row in rows.values())
    assert rows["lists"]["mean_error"] == 0.0 and rows["lists"]["error"]["relative_mse"] == 0.0
    assert 0.0 < rows["sorted"]["mean_error"] < 0.1 and 0.0 < rows["weighted"]["mean_error"] < 0.1


def test_the_table_says_all_of_it(record):
    console = Console(file=io.StringIO(), width=140)
    transparency.show(record, console)
    text = console.file.getvalue()
    assert all(way in text for way in transparency.WAYS) and "relative MSE" in text
