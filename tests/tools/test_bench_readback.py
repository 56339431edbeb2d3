"""Readback by kind of memory: what the GPU wrote arrives, from every kind, and rates are rates."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from backends.vulkan import api as vk
from backends.vulkan.memory import choose_memory_type
from tools.bench import readback
from tools.bench.points import QUICK


@pytest.mark.variants("vulkan")
def test_every_kind_of_memory_gives_what_the_gpu_wrote(vulkan_device):
    made = readback.measure(vulkan_device, QUICK, lambda name, part: None, 1 << 20)
    visible = [
        kind for kind in vulkan_device.memory.types if kind.flags & vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT
    ]
    assert 1 <= len(made["points"]) <= len(visible)
    assert all(point["same"] for point in made["points"])
    for point in made["points"]:
        assert point["gb_per_s"] == pytest.approx((1 << 20) / point["ms"] / 1e6)
        assert point["times_faster"] >= 1.0
    text = StringIO()
    readback.show(made, Console(file=text, width=80))
    assert all(point["kind"].split(",")[0] in text.getvalue() for point in made["points"])


@pytest.mark.variants("vulkan")
def test_readbacks_take_cached_memory_where_there_is_some(vulkan_device):
    types = vulkan_device.memory.types
    cached = [i for i, kind in enumerate(types) if kind.flags & vk.VK_MEMORY_PROPERTY_HOST_CACHED_BIT]
    chosen = choose_memory_type(types, (1 << len(types)) - 1, "readback")
    assert chosen in cached or not cached
