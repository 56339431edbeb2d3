"""Self-test: a vertex shader reads its vertices from a storage buffer by index, and its instance by number."""

from __future__ import annotations

from typing import Any

from backends.selftest import draws as data
from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import Bench


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    indices = bench.input(data.PULLED_INDICES, vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT)
    sources = {"vert": data.PULLED_VERTEX, "frag": data.NUMBER_FRAGMENT}
    program = bench.graphics(sources, [bench.input(data.PULLED_CORNERS), bench.input(data.PULLED_COLORS)])
    first, instances = data.PULLED_INSTANCES

    def record(commands: Any) -> None:
        bench.fn.vkCmdBindIndexBuffer(commands, indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        bench.fn.vkCmdDrawIndexed(commands, data.PULLED_INDICES.size, instances, 0, 0, first)

    return data.pulled_wrong(bench.render(program, data.SIZE, record))
