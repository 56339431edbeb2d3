"""Self-test: compute invocations are counted around a mesh draw (mesh shaders are none), and nothing crashes."""

from __future__ import annotations

from backends.vulkan import api as vk
from backends.vulkan.selftests import mesh_shader_statistics
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    return mesh_shader_statistics.run(bench, vk.VK_QUERY_PIPELINE_STATISTIC_COMPUTE_SHADER_INVOCATIONS_BIT)
