"""The presets of the chapter are worth their time: points of the measured Pareto front, on the device class at hand."""

from __future__ import annotations

import pytest

from backends.vulkan.instance import Instance, choose
from common.errors import UnsupportedError
from tests.support import snapshots
from tools.bench import bench, points


@pytest.mark.newest
@pytest.mark.runs_on("vulkan")
@pytest.mark.feature("tools/presets")
def test_no_preset_is_slower_and_less_true_than_another_in_the_newest_record(request):
    number = snapshots.tested(request.node).number
    try:
        with Instance() as instance:
            kind = choose(instance.devices()).kind
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")
    path = bench.record_path(number, kind)
    if not path.is_file():
        pytest.skip(
            f"chapter {number} was not measured on a device of class {kind}: ./strata bench {number} --record"
        )
    record = bench.read_record(path)
    assert {point["name"] for point in record["points"]} >= {"low", "medium", "high", "reference"}
    assert points.dominated(record["points"]) == []
    for swept in record["prepared"]:
        assert points.dominated(swept["points"]) == [], swept["name"]
