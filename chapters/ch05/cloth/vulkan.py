"""The cloth pass: all cloths are moved by as many steps as have become due, and drawn from where they are then."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once

from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..frames.vulkan_resources import Resources
from ..pipelines.vulkan import Built, Pipelines
from ..pipelines.vulkan_compute import ComputePipeline
from ..pipelines.vulkan_descriptors import Descriptors
from ..scene.vulkan_data import SceneData
from ..settings import Settings
from .declared import ClothSteps, title
from .dispatches import Dispatch, Kernel
from .layout import Limits, Packed
from .scene import ClothScene
from .vulkan_buffers import ClothBuffers

_TO_THE_CPU = barriers(
    memory=(
        vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
        vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
        vk.VK_PIPELINE_STAGE_2_HOST_BIT,
        vk.VK_ACCESS_2_HOST_READ_BIT,
    )
)


class ClothPass(ClothSteps):
    """Simulation, normals and vertices of all cloths, on the compute queue where there is one."""

    def __init__(
        self,
        found: ClothScene,
        settings: Settings,
        data: SceneData,
        pipelines: Pipelines,
        device: Device,
        resources: Resources,
        descriptors: Descriptors,
    ) -> None:
        limits = device.limits
        super().__init__(
            found,
            settings,
            data,
            Limits(
                int(limits.maxStorageBufferRange),
                int(limits.maxComputeWorkGroupCount[0]),
                int(limits.maxComputeWorkGroupInvocations),
                int(limits.maxComputeSharedMemorySize),
            ),
        )
        self._scene_data, self._pipelines, self._device = data, pipelines, device
        self._resources, self._descriptors = resources, descriptors
        self._made: dict[Kernel, Built] = {}
        self._sets: Any = None
        self._bound: dict[tuple[Kernel, int, int], Any] = {}  # by slot and page: an array of one set

    def make_memory(self, packed: Packed, before: Any) -> ClothBuffers:
        """Return the buffers, whose state is that of `before`."""
        self._buffers = ClothBuffers(self._device, self._resources, packed, before)
        return self._buffers

    def make_kernels(self, kernels: list[Kernel]) -> None:
        """Make the pipelines, and a set for each kernel, slot and page that it writes to."""
        described = [
            ComputePipeline(one.file, tuple(one.defines.items()), name=title(one)) for one in kernels
        ]
        self._made = dict(zip(kernels, self._pipelines.get(described), strict=True))
        if self._sets is not None:
            self._resources.defer(partial(self._descriptors.destroy, self._sets))
        assert self.frames is not None
        written = sorted({page for page, *_ in self.frames.packed.vertex_runs})
        keys = [
            (kernel, slot, page)
            for kernel in kernels
            for slot in range(SLOTS)
            for page in (written if "words" in kernel.buffers else (-1,))
        ]
        wanted = []
        for kernel, slot, page in keys:
            layout = self._made[kernel].sets[0]
            assert layout is not None, kernel.file
            held = {
                binding: self._scene_data.page_buffer(slot, page)
                if name == "words"
                else self._buffers.buffer(name, slot)
                for binding, name in enumerate(kernel.buffers)
            }
            wanted.append((layout, held, f"{title(kernel)}, slot {slot}"))
        self._sets = self._descriptors.create(wanted)
        handles = [vk.array("VkDescriptorSet", [one]) for one in self._sets.handles]
        self._bound = dict(zip(keys, handles, strict=True))

    @contextmanager
    def at_once(self, slot: int) -> Iterator[Commands]:
        """Give commands for a slot that have run when this is left."""
        self._device.wait_idle()
        commands = Commands(self._device)
        with submit_once(self._device) as handle:
            where: Any = SimpleNamespace(index=slot, commands=handle)
            commands.begin(where)
            yield commands

    def record(self, commands: Commands) -> None:
        """Record the dispatches of this frame, each behind those whose results it reads."""
        slot = commands.slot.index
        bound: Dispatch | None = None
        for one in self.dispatched(slot):
            pipeline = self._made[one.kernel]
            if bound is None or one.kernel != bound.kernel:
                commands.bind_compute(pipeline)
            if bound is None or (one.kernel, one.page) != (bound.kernel, bound.page):
                commands.bind_compute_set(pipeline, 0, self._bound[one.kernel, slot, one.page])
            bound = one
            if one.after:
                commands.compute_barrier()
            if pipeline.push_stages:
                commands.push(pipeline, np.array(one.push, np.uint32))
            commands.dispatch(*one.groups)
        if bound is not None:
            commands.barrier(_TO_THE_CPU)
