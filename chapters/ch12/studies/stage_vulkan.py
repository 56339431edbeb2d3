"""The stage of this chapter's studies on Vulkan: what all studies share, with this chapter's graphics layer.

These studies compute, too: the stage makes buffers for shaders to fill, and copies them to the CPU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.stage import USAGES, Graphics
from backends.vulkan.stage import Stage as AnyStage

from ..frames import frame
from ..frames.vulkan import Frames
from ..frames.vulkan_commands import Commands, Rendering
from ..frames.vulkan_profiler import Profiler
from ..frames.vulkan_resources import target_usage
from ..pipelines.description import Built
from ..pipelines.vulkan import Pipelines
from ..pipelines.vulkan_descriptors import Descriptors, Held

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
READ = (
    vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT,
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT,
)


class Stage(AnyStage):
    """A study of this chapter on Vulkan."""

    frame_logic = frame
    graphics = Graphics(Frames, Commands, Rendering, Descriptors, Pipelines, Profiler, target_usage)
    pipelines: Pipelines
    descriptors: Descriptors
    shown = barriers(memory=(*READ, *WRITTEN))
    """What the last frame reads has been read."""
    computed = barriers(memory=(*WRITTEN, *READ))

    def set_of(self, pipeline: Built, held: Mapping[int, Held], name: str, sized: bool = False) -> Any:
        """Return a descriptor set of a pipeline's bindings, for `bind_set` and `bind_compute_set`; `held` are the
        resources.

        A `sized` set is freed when the picture's size changes.
        """
        layout = pipeline.sets[0]
        assert layout is not None  # a pipeline without bindings needs no set
        sets = self.descriptors.create([(layout, held, name)])
        if sized:
            self.keep_sized(sets, self.descriptors.destroy)
        return vk.array("VkDescriptorSet", sets.handles)

    def compute(
        self, commands: Commands, kernel: Built, bound: Any, pushed: np.ndarray | None, extent: Sequence[int]
    ) -> None:
        """Dispatch as many work groups as cover `extent`, and let kernels and fragments behind see what they write."""
        commands.bind_compute(kernel)
        commands.bind_compute_set(kernel, 0, bound)
        if pushed is not None:
            commands.push(kernel, pushed)
        commands.dispatch_over(kernel, extent)
        commands.barrier(self.computed)

    def empty(self, size: int, uses: Sequence[str], name: str, sized: bool = False) -> Buffer:
        """Return a buffer in the GPU's own memory for shaders to fill; `download` copies it.

        A `sized` buffer is freed when the picture's size changes.
        """
        usage = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        for use in uses:
            usage |= USAGES[use]
        buffer = create_buffer(self.device, size, usage, "device", name)
        return (self.keep_sized if sized else self.keep)(
            buffer, lambda resource: destroy_buffer(self.device, resource)
        )

    def shared(self, size: int, name: str) -> Buffer:
        """Return a buffer for shaders to fill, in memory that the CPU reads through a mapping."""
        return self._buffer(size, USAGES["storage"], "readback", name)

    def download(self, buffer: Buffer, written: tuple[int, int]) -> np.ndarray:
        """Return a copy of a buffer's bytes, (size,) uint8, waiting for this copy only.

        `written` are the stages and the access of the last shader writes. Two barriers lead to the CPU: one makes the
        shader writes visible to the copy, the other makes the copy visible to the host.
        """
        copied = create_buffer(
            self.device, buffer.size, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "readback", "download"
        )
        read = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_READ_BIT)
        try:
            with submit_once(self.device) as commands:
                fn = self.device.fn
                fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*written, *read)))
                region = vk.array("VkBufferCopy", [vk.new("VkBufferCopy", size=buffer.size)])
                fn.vkCmdCopyBuffer(commands, buffer.handle, copied.handle, 1, region)
                fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            self.device.memory.invalidate(copied.allocation)
            return copied.mapped.copy()
        finally:
            destroy_buffer(self.device, copied)
