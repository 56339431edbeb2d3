"""Self-test: minimum, maximum and bitwise or over a subgroup, also where only some of its invocations take part."""

from __future__ import annotations

from backends.selftest import data as data
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return bench.computes(data.subgroups(), ["GL_KHR_shader_subgroup_arithmetic"])
