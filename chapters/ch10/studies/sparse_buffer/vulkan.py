"""The study sparse-buffer on Vulkan: pages that are bound to other places, and a kernel that checks them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.resources import Buffer
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built, PipelineDescription
from ..sparse_vulkan import bind, lacks, page_memory
from ..stage_vulkan import Stage
from . import KERNELS, NONE, PAGE_BYTES, PLACES, SHADERS, STUDY, Settings, defines, layout, told, work_of

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
READ = (
    vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT,
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT,
)
HOST = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """A buffer whose pages move through its addresses."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Make the buffer without memory, the pages, and what the CPU writes for each frame."""
        missing = lacks(self.device, self.without, "sparseResidencyBuffer")
        if missing:
            raise UnsupportedError(
                f"The study sparse-buffer needs buffers of which some pages have no memory, but {missing}."
            )
        self._make_buffer()
        self._at = np.full(PLACES, NONE, np.uint32)
        self._written = False
        self._places = self.per_slot(4 * PLACES, "storage", "places")
        slots = range(self.frame_logic.SLOTS)
        self._counts = [self.shared(8 * PLACES, f"counts, slot {slot}") for slot in slots]
        self._write, self._check, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, defines(), name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, defines(), color="rgba8", depth=None, name="show"),
            ]
        )
        self._sets = [
            {
                pipeline: self.set_of(pipeline, {0: places, 1: self.buffer, 2: counts}, "pages")
                for pipeline in (self._write, self._check, self._show)
            }
            for places, counts in zip(self._places, self._counts, strict=True)
        ]
        self._to_check = barriers(memory=(*WRITTEN, *READ))
        self._counted = barriers(memory=(*WRITTEN, *HOST))

    def _make_buffer(self) -> None:
        device = self.device
        info = vk.new(
            "VkBufferCreateInfo",
            flags=vk.VK_BUFFER_CREATE_SPARSE_BINDING_BIT | vk.VK_BUFFER_CREATE_SPARSE_RESIDENCY_BIT,
            size=PLACES * PAGE_BYTES,
            usage=vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
            sharingMode=vk.VK_SHARING_MODE_EXCLUSIVE,
        )
        handle = device.create("vkCreateBuffer", info, "sparse buffer")
        self.keep(handle, lambda buffer: device.destroy("VkBuffer", buffer))
        self.buffer = Buffer(handle, PLACES * PAGE_BYTES, None, "sparse buffer")
        requirements = vk.new("VkMemoryRequirements")
        device.fn.vkGetBufferMemoryRequirements(device.handle, handle, requirements)
        if PAGE_BYTES % int(requirements.alignment):
            raise UnsupportedError(
                f"The device binds {requirements.alignment} bytes at a time, more than 64 KiB."
            )
        memory = page_memory(device, requirements, self.settings.pages, PAGE_BYTES)
        self._memory = self.keep(memory, lambda held: device.destroy("VkDeviceMemory", held))

    def _move(self, after: NDArray[np.uint32]) -> None:
        """Bind the places whose page is another one now, once no frame reads them."""
        changed = np.flatnonzero(after != self._at).tolist()
        if not changed:
            return
        self.device.wait_idle()
        binds: list[dict[str, Any]] = [
            {"resourceOffset": place * PAGE_BYTES, "size": PAGE_BYTES} for place in changed
        ]
        for place, place_bind in zip(changed, binds, strict=True):
            if after[place] != NONE:
                place_bind |= {"memory": self._memory, "memoryOffset": int(after[place]) * PAGE_BYTES}
        bind(self.device, None, self.buffer.handle, binds)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Move the pages, check what they hold, and show it; the first frame writes it."""
        slot, after = commands.slot.index, layout(self.settings, time)
        self.work = work_of(self.settings, self._at, after, not self._written)
        self._move(after)
        self._at = after
        self._places[slot].view(np.uint32)[:] = after
        if not self._written:
            self._dispatch(commands, self._write)
            self._written = True
        commands.barrier(self._to_check)  # always: what was written may be at another address now
        self._dispatch(commands, self._check)
        commands.barrier(self._counted)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._sets[slot][self._show])
        commands.push(self._show, np.array([*self.size, 0, 0], np.float32))
        commands.draw_triangle()
        self.end(commands)

    def _dispatch(self, commands: Commands, kernel: Built) -> None:
        commands.begin_label(kernel.described.name)
        commands.bind_compute(kernel)
        commands.bind_compute_set(kernel, 0, self._sets[commands.slot.index][kernel])
        commands.dispatch(PLACES)
        commands.end_label()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return what the slot's frame counted, after a wait for it."""
        self._frames.wait(slot)
        counts = self._counts[slot.index]
        self.device.memory.invalidate(counts.allocation)
        self.last_counts = counts.view(np.uint32).reshape(PLACES, 2).copy()
        return told(self.last_counts)
