"""The presets of the chapter are worth their time: points of the measured Pareto front, on the device class at hand."""

from __future__ import annotations

import pytest

from backends.vulkan.instance import Instance, choose
from chapters import bench, bench_points
from common.errors import UnsupportedError


@pytest.mark.feature("tools/presets")
def test_no_preset_is_slower_and_less_true_than_another_in_the_newest_record():
    try:
        with Instance() as instance:
            kind = choose(instance.devices()).kind
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")
    path = bench.record_path(1, kind)
    if not path.is_file():
        pytest.skip(f"chapter 1 was not measured on a device of class {kind}: ./strata bench 1 --record")
    record = bench.read_record(path)
    assert {point["name"] for point in record["points"]} >= {"low", "medium", "high", "reference"}
    assert bench_points.dominated(record["points"]) == []
    for swept in record["prepared"]:
        assert bench_points.dominated(swept["points"]) == [], swept["name"]
