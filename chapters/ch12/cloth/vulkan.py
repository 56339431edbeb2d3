"""Cloth on Vulkan: buffers, descriptor sets, and the barrier after the kernels.

The input and the stats of a frame exist once per slot; the CPU reads the stats when it uses the slot again. All other
buffers exist once: frames of the simulation follow one another on one queue.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle

from ..frames.backend.vulkan import VulkanBackend
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..frames.vulkan_resources import Resources
from ..pipelines.description import Built
from .dispatches import Kernel
from .layout import Limits, Packed
from .passes import FRAME, STATE, title

_STORAGE = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT


class ClothBuffers:
    """The buffers by name; those of FRAME exist once per slot."""

    def __init__(
        self, device: Device, resources: Resources, packed: Packed, before: ClothBuffers | None = None
    ) -> None:
        self._device, self._resources = device, resources
        sizes = packed.sizes()
        self._handles: dict[str, Handle] = {}
        if before is not None:
            self._handles = {name: before._handles.pop(name) for name in STATE}
            before.close()
        new = [name for name in packed.arrays if name not in self._handles]
        for name in new:
            usage = _STORAGE | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
            self._handles[name] = resources.buffer(sizes[name], usage, "device", f"cloth {name}", shared=True)
        for name, use in FRAME.items():
            for slot in range(SLOTS):
                handle = resources.buffer(sizes[name], _STORAGE, use, f"cloth {name}, slot {slot}")
                self._handles[f"{name} {slot}"] = handle
        # The uploader waits, so earlier copies into the pages are then visible to every queue, too.
        with Uploader(device) as uploader:
            for name in new:
                uploader.buffer(self.buffer(name), packed.arrays[name])

    def buffer(self, name: str, slot: int = 0) -> Buffer:
        """Return a buffer by its name; of a buffer of FRAME, that of the slot."""
        return self._resources.buffers.get(self._handles[f"{name} {slot}" if name in FRAME else name])

    def stats(self, slot: int) -> NDArray[np.uint8]:
        """Return the bytes that the last frame of a slot wrote about each cloth."""
        buffer = self.buffer("stats", slot)
        return buffer.mapped[: buffer.size].copy()

    def read(self, name: str) -> NDArray[np.float32]:
        """Return the contents of a buffer that exists once; all frames must be over."""
        buffer = self.buffer(name)
        usage = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        copied = create_buffer(self._device, buffer.size, usage, "readback", f"cloth {name}, read")
        try:
            with submit_once(self._device) as commands:
                region = vk.new("VkBufferCopy", size=buffer.size)
                self._device.fn.vkCmdCopyBuffer(commands, buffer.handle, copied.handle, 1, region)
                self._device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            self._device.memory.invalidate(copied.allocation)
            contents: NDArray[np.float32] = copied.view(np.float32).copy()
            return contents
        finally:
            destroy_buffer(self._device, copied)

    def write(self, slot: int, arrays: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write the input of a frame."""
        for name, data in arrays.items():
            self.buffer(name, slot).mapped[: data.size] = data

    def close(self) -> None:
        """Give the buffers up; frames in flight may still use them."""
        for handle in self._handles.values():
            self._resources.destroy_buffer(handle)
        self._handles = {}


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
        self._bound: dict[tuple[Kernel, int, int], Any] = {}  # by kernel, slot and page: an array of one set

    def make_memory(self, packed: Packed, before: ClothBuffers | None) -> ClothBuffers:
        """Return the buffers, with the state of `before`."""
        self._buffers = ClothBuffers(self._device, self._resources, packed, before)
        return self._buffers

    def make_kernels(self, kernels: Mapping[Kernel, Built], pages: Collection[int]) -> None:
        """Make a descriptor set for each kernel, slot and page that it writes to."""
        self._pipelines = kernels
        if self._sets is not None:
            self._resources.defer(partial(self._descriptors.destroy, self._sets))
        keys = [
            (kernel, slot, page)
            for kernel in kernels
            for slot in range(SLOTS)
            for page in (pages if "words" in kernel.buffers else (-1,))
        ]
        described = []
        for kernel, slot, page in keys:
            layout = kernels[kernel].sets[0]
            assert layout is not None, kernel.file
            bindings = {
                binding: self._data.page_buffer(slot, page)
                if name == "words"
                else self._buffers.buffer(name, slot)
                for binding, name in enumerate(kernel.buffers)
            }
            described.append((layout, bindings, f"{title(kernel)}, slot {slot}"))
        self._sets = self._descriptors.create(described)
        handles = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        self._bound = dict(zip(keys, handles, strict=True))

    def bind(self, commands: Commands, kernel: Kernel, slot: int, page: int) -> None:
        """Bind the descriptor set of a kernel."""
        commands.bind_compute_set(self._pipelines[kernel], 0, self._bound[kernel, slot, page])

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the stats visible to the CPU; the graph's barriers stand between the vertices and the draws."""
        commands.barrier(_TO_THE_CPU)

    @contextmanager
    def at_once(self, slot: int) -> Iterator[Commands]:
        """Yield commands for a slot; they have run on leaving."""
        self._device.wait_idle()
        commands = Commands(self._device)
        with submit_once(self._device) as handle:
            frame_slot: Any = SimpleNamespace(index=slot, commands=handle)
            commands.begin(frame_slot)
            yield commands
