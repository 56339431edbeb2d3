"""The kernels of cloth on Vulkan: what binds their buffers, and the barrier behind them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.once import submit_once

from ..frames.frame import SLOTS
from ..frames.vulkan_backend import VulkanBackend
from ..frames.vulkan_commands import Commands
from ..pipelines.description import Built
from .dispatches import Kernel
from .layout import Limits, Packed
from .passes import title
from .vulkan_buffers import ClothBuffers

_TO_THE_CPU = barriers(
    memory=(
        vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
        vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
        vk.VK_PIPELINE_STAGE_2_HOST_BIT,
        vk.VK_ACCESS_2_HOST_READ_BIT,
    )
)


class ClothKernels:
    """Buffers, and a descriptor set for each kernel, slot and page that the kernel writes to."""

    def __init__(self, backend: VulkanBackend) -> None:
        self._device, self._data = backend.device, backend.data
        self._resources, self._descriptors = backend.resources, backend.descriptors
        limits = backend.device.limits
        self.limits = Limits(
            int(limits.maxStorageBufferRange),
            int(limits.maxComputeWorkGroupCount[0]),
            int(limits.maxComputeWorkGroupInvocations),
            int(limits.maxComputeSharedMemorySize),
        )
        self._pipelines: Mapping[Kernel, Built] = {}
        self._sets: Any = None
        self._bound: dict[tuple[Kernel, int, int], Any] = {}  # by slot and page: an array of one set

    def make_memory(self, packed: Packed, before: ClothBuffers | None) -> ClothBuffers:
        """Return the buffers, whose state is that of `before`."""
        self._buffers = ClothBuffers(self._device, self._resources, packed, before)
        return self._buffers

    def make_kernels(self, kernels: Mapping[Kernel, Built], pages: Collection[int]) -> None:
        """Make a set for each kernel, slot and page that it writes to."""
        self._pipelines = kernels
        if self._sets is not None:
            self._resources.defer(partial(self._descriptors.destroy, self._sets))
        keys = [
            (kernel, slot, page)
            for kernel in kernels
            for slot in range(SLOTS)
            for page in (pages if "words" in kernel.buffers else (-1,))
        ]
        wanted = []
        for kernel, slot, page in keys:
            layout = kernels[kernel].sets[0]
            assert layout is not None, kernel.file
            held = {
                binding: self._data.page_buffer(slot, page)
                if name == "words"
                else self._buffers.buffer(name, slot)
                for binding, name in enumerate(kernel.buffers)
            }
            wanted.append((layout, held, f"{title(kernel)}, slot {slot}"))
        self._sets = self._descriptors.create(wanted)
        handles = [vk.array("VkDescriptorSet", [one]) for one in self._sets.handles]
        self._bound = dict(zip(keys, handles, strict=True))

    def bind(self, commands: Commands, kernel: Kernel, slot: int, page: int) -> None:
        """Bind the set of a kernel."""
        commands.bind_compute_set(self._pipelines[kernel], 0, self._bound[kernel, slot, page])

    def finish(self, commands: Commands, slot: int) -> None:
        """Let the CPU see the answers; the graph's barriers stand between the vertices and the draws."""
        commands.barrier(_TO_THE_CPU)

    @contextmanager
    def at_once(self, slot: int) -> Iterator[Commands]:
        """Give commands for a slot that have run when this is left."""
        self._device.wait_idle()
        commands = Commands(self._device)
        with submit_once(self._device) as handle:
            where: Any = SimpleNamespace(index=slot, commands=handle)
            commands.begin(where)
            yield commands
