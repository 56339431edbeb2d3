"""The counters of casters on Vulkan."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.resources import Buffer

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands
from ..memory import TABLES
from .model import WORDS
from .model import ShadowCounts as _ShadowCounts

_COUNTED = (
    vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
    vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
)
TOLD_BINDING = 9
"""The binding of the counters, behind those of cull.glsl."""

_FOR_THE_CPU = barriers(memory=(*_COUNTED, vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT))


class ShadowCounts(_ShadowCounts):
    """A buffer for each slot, and sets for the tables that there are now."""

    def _create(self) -> None:
        resources = self._backend.resources
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        self._handles = [
            resources.buffer(4 * WORDS, usage, "readback", f"shadow counters, slot {slot}")
            for slot in range(SLOTS)
        ]
        self._sets: Any = None
        self._bound: tuple[Any, ...] = ()

    def _buffer(self, slot: int) -> Buffer:
        buffer: Buffer = self._backend.resources.buffers.get(self._handles[slot])
        return buffer

    def _read(self, slot: int) -> NDArray[np.uint32]:
        buffer = self._buffer(slot)
        assert buffer.allocation is not None, "the CPU reads it"
        self._backend.device.memory.invalidate(buffer.allocation)
        return buffer.view(np.uint32).copy()[:WORDS]

    def _bind(self, commands: Any, memory: Any) -> None:
        bound = tuple(id(memory._table(name)) for name in TABLES)
        if self._sets is None or bound != self._bound:
            self._forget_sets()
            self._sets = self._backend.descriptors.create(
                [
                    (
                        self._kernel.sets[0],
                        {**memory.held_tables(slot), TOLD_BINDING: self._buffer(slot)},
                        f"shadow counters, slot {slot}",
                    )
                    for slot in range(SLOTS)
                ]
            )
            self._bound = bound
            self._arrays = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        commands.bind_compute(self._kernel)
        commands.bind_compute_set(self._kernel, 0, self._arrays[commands.slot.index])

    def _forget_sets(self) -> None:
        if self._sets is not None:
            self._backend.resources.defer(partial(self._backend.descriptors.destroy, self._sets))
        self._sets, self._bound = None, ()

    def finish(self, commands: Commands) -> None:
        """Make the counters visible to the CPU."""
        commands.barrier(_FOR_THE_CPU)

    def close(self) -> None:
        """Give buffers and sets up; frames in flight may still use them."""
        self._forget_sets()
        for handle in self._handles:
            self._backend.resources.destroy_buffer(handle)
        self._handles = []
