"""Our BVH on Vulkan."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands
from ...pipelines.description import Built
from ...pipelines.vulkan_descriptors import Held, Sets
from ...visibility.vulkan import Bindings
from .kernels import PAGE, PLACES, TOLD
from .memory import BvhMemory
from .vulkan_told import Told

_COPIED = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
_STORED = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | _COPIED


class Memory(BvhMemory):
    """Buffers of the renderer's resources, which free them, and a descriptor set for each kernel, slot and page."""

    surfaces = Bindings
    _sets: Sets | None = None

    def _create(self, content: Mapping[str, NDArray[np.uint8]]) -> dict[str, Buffer]:
        buffers, resources = {}, self._backend.resources
        with Uploader(self._backend.device) as uploader:
            for name, part in content.items():
                handle = resources.buffer(part.nbytes, _STORED, "device", f"rays: {name}")
                buffers[name] = resources.buffers.get(handle)
                uploader.buffer(buffers[name], part)
        return buffers

    def _replace(self, content: Mapping[str, NDArray[np.uint8]]) -> None:
        self._backend.device.wait_idle()
        with Uploader(self._backend.device) as uploader:
            for name, part in content.items():
                if self.buffers[name].size >= part.nbytes:
                    uploader.buffer(self.buffers[name], part)
        self._make_bindings()

    def _make_bindings(self) -> None:
        descriptors, data = self._backend.descriptors, self._data
        if self._sets is not None:
            self._backend.resources.defer(partial(descriptors.destroy, self._sets))
        held: dict[tuple[str, int, int], dict[int, Held]] = {}
        for slot in range(SLOTS):
            for kernel, names in self._bound.items():
                known: dict[int, Held] = {
                    at: self.buffers[name] for at, name in enumerate(names) if name in self.buffers
                }
                if TOLD in names:
                    known[names.index(TOLD)] = self.told[slot]
                if PLACES in names:
                    known |= data.held_instances(slot, names.index(PLACES), len(names) - 1)
                if PAGE not in names:
                    held[kernel, slot, 0] = known
                    continue
                for page in range(len(data.pages)) if self._deforming else ():
                    own: dict[int, Held] = {names.index(PAGE): data.page_buffer(slot, page)}
                    held[kernel, slot, page] = known | own
        described = []
        for (kernel, slot, page), content in held.items():
            layout = self._built[kernel].sets[0]
            assert layout is not None, "the kernel has buffers"
            described.append((layout, content, f"ray {kernel}, slot {slot}, page {page}"))
        self._sets = descriptors.create(described)
        handles = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        self._set_of = dict(zip(held, handles, strict=True))

    def _bind_kernel(self, commands: Commands, kernel: str, pipeline: Built, slot: int, page: int) -> None:
        commands.bind_compute(pipeline)
        commands.bind_compute_set(pipeline, 0, self._set_of[kernel, slot, page])

    def _create_told(self, count: int) -> list[Buffer]:
        self._told = Told(self._backend.device, count, "costs")
        return self._told.buffers

    def _read_told(self, slot: int) -> NDArray[np.float32]:
        return self._told.read(slot)

    def _finish_told(self, commands: Commands) -> None:
        self._told.finish(commands)

    def close(self) -> None:
        """Free the sets and what the CPU reads; the other buffers belong to the resources."""
        if self._watch:
            self._told.close()
        if self._sets is not None:
            self._backend.descriptors.destroy(self._sets)
            self._sets = None


open_structures = Memory
