"""Kernels, buffers and acceleration structures of the bench of rays on Vulkan; compare gl_rays.py."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader

from ..frames.vulkan_commands import Commands
from ..pipelines.description import Built, Described
from ..pipelines.vulkan import Pipelines
from ..pipelines.vulkan_descriptors import Descriptors, Held, Structure
from ..rays.bvh.morton import order as morton_order
from ..rays.model import CULL_DISABLE, FORCE_OPAQUE
from ..rays.picture import FEATURES
from ..rays.triangles import build_order
from ..rays.vulkan_build import BUILD_AFTER_BUILD, INPUT, Bottoms
from ..rays.vulkan_geometry import MeshGeometry
from ..rays.vulkan_top import TopLevel
from .rays_scenes import Geometry

_COPIES = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
_STORAGE = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
_ALL = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
_READ, _WRITE = vk.VK_ACCESS_2_MEMORY_READ_BIT, vk.VK_ACCESS_2_MEMORY_WRITE_BIT
_BETWEEN = barriers(memory=(_ALL, _READ | _WRITE, _ALL, _READ | _WRITE))


class Gpu:
    """What runs the bench's kernels on a device; `close` frees all that it made."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.pipelines, self.descriptors = Pipelines(device), Descriptors(device)
        self._commands = Commands(device)
        self._buffers: list[Buffer] = []
        self._sets: list[Any] = []

    @property
    def ways(self) -> tuple[str, ...]:
        """The ways of the driver that the device has."""
        return tuple(way for way, feature in FEATURES.items() if self.device.has(feature))

    def buffer(self, array: NDArray[Any], name: str) -> Buffer:
        """Return a buffer in the GPU's own memory with this content."""
        raw = np.ascontiguousarray(array).view(np.uint8).reshape(-1)
        usage = _STORAGE | _COPIES
        if self.ways:
            usage |= INPUT
        buffer = create_buffer(self.device, max(raw.size, 4), usage, "device", f"bench: {name}")
        self._buffers.append(buffer)
        with Uploader(self.device) as uploader:
            uploader.buffer(buffer, raw)
        return buffer

    def read(self, buffer: Buffer, dtype: Any) -> NDArray[Any]:
        """Return a copy of a buffer's content."""
        copied = create_buffer(self.device, buffer.size, _COPIES, "readback", "bench: copy")
        try:
            with submit_once(self.device) as handle:
                self.device.fn.vkCmdPipelineBarrier2(handle, _BETWEEN)
                region = vk.array("VkBufferCopy", [vk.new("VkBufferCopy", size=buffer.size)])
                self.device.fn.vkCmdCopyBuffer(handle, buffer.handle, copied.handle, 1, region)
                self.device.fn.vkCmdPipelineBarrier2(handle, barriers(memory=TO_HOST))
            self.device.memory.invalidate(copied.allocation)
            return copied.view(dtype).copy()
        finally:
            destroy_buffer(self.device, copied)

    def kernel(self, described: Described) -> Built:
        """Return the pipeline of a description."""
        return self.pipelines.get([described])[0]

    def bound(self, kernel: Built, held: Mapping[int, Held]) -> Any:
        """Return what `seconds` binds: the resources of a kernel's set 0 by binding."""
        layout = kernel.sets[0]
        assert layout is not None, "the kernels of the bench have buffers"
        sets = self.descriptors.create([(layout, dict(held), "bench of rays")])
        self._sets.append(sets)
        return vk.array("VkDescriptorSet", sets.handles)

    def seconds(self, calls: Sequence[tuple[Built, Any, int, Sequence[int]]], times: int = 1) -> float:
        """Run calls (kernel, bound, invocations, push), one after the other; return the seconds of all, waited for.

        With `times` they run so often in one submission, and the seconds are those of once.
        """
        commands = self._commands
        began = clock.perf_counter()
        with submit_once(self.device) as handle:
            slot: Any = SimpleNamespace(commands=handle, index=0)
            commands.begin(slot)
            for _ in range(times):
                for kernel, bound, invocations, push in calls:
                    commands.bind_compute(kernel)
                    commands.bind_compute_set(kernel, 0, bound)
                    commands.push(kernel, np.array(push, np.uint32))
                    commands.trace(kernel, (invocations,))
                    commands.barrier(_BETWEEN)
        return (clock.perf_counter() - began) / times

    def close(self) -> None:
        """Free everything."""
        self.device.wait_idle()
        for sets in self._sets:
            self.descriptors.destroy(sets)
        for buffer in self._buffers:
            destroy_buffer(self.device, buffer)
        self.descriptors.close()
        self.pipelines.close()


class Driver:
    """The structures that the driver builds of a geometry; with `refits` they can be updated, and are not compacted."""

    def __init__(self, gpu: Gpu, geometry: Geometry, refits: bool = False) -> None:
        self._gpu = gpu
        kept = [build_order(indices, positions) for indices, positions in geometry.meshes]
        described, begins, end = [], [], len(geometry.mesh_of)
        for number, ((indices, positions), order) in enumerate(zip(geometry.meshes, kept, strict=True)):
            where = buffer_address(gpu.device, gpu.buffer(positions, "positions"))
            listed = buffer_address(gpu.device, gpu.buffer(indices[order], "indices"))
            described.append(
                MeshGeometry(where, len(positions), listed, len(order), f"mesh {number}", refits)
            )
            begins.append(end)
            end += len(order)
        words = np.concatenate([np.array(begins)[geometry.mesh_of], *kept]).astype(np.uint32)
        self.orders = gpu.buffer(words, "order of triangles")
        began = clock.perf_counter()
        self._bottoms = Bottoms(gpu.device, described)
        self._top = TopLevel(gpu.device, len(geometry.mesh_of))
        made = clock.perf_counter() - began
        with Uploader(gpu.device) as uploader:
            uploader.buffer(self._top.records, self._records(geometry))
        self.build_ms = 1e3 * (made + self._run(lambda commands: self._top.record(commands)))
        """The time of all builds, with the allocation of their memory and the copies of compaction."""
        self.world = Structure(self._top.handle)

    def _records(self, geometry: Geometry) -> NDArray[np.uint32]:
        """Return (I, 16) words: the records of the instances in Morton order of their places."""
        records = np.zeros((len(geometry.mesh_of), 16), np.uint32)
        records[:, :12] = geometry.matrices.astype(np.float32).reshape(-1, 12).view(np.uint32)
        records[:, 12] = np.arange(len(records)) | 0xFF << 24
        records[:, 13] = (CULL_DISABLE | FORCE_OPAQUE) << 24
        addresses = np.array([it.address for it in self._bottoms.all], np.uint64)[geometry.mesh_of]
        records[:, 14:] = addresses[:, None].view(np.uint32)
        centres = np.array([(points.min(axis=0) + points.max(axis=0)) / 2 for _, points in geometry.meshes])
        placed = np.einsum("nij,nj->ni", geometry.matrices[:, :, :3], centres[geometry.mesh_of])
        return records[morton_order((placed + geometry.matrices[:, :, 3]).astype(np.float32))]

    def _run(self, record: Any) -> float:
        began = clock.perf_counter()
        with submit_once(self._gpu.device) as commands:
            self._gpu.device.fn.vkCmdPipelineBarrier2(commands, BUILD_AFTER_BUILD)
            record(commands)
            self._gpu.device.fn.vkCmdPipelineBarrier2(commands, _BETWEEN)
        return clock.perf_counter() - began

    def refit_seconds(self) -> float:
        """Update the structures of meshes, and return the seconds, waited for."""
        vertices = [
            it.geometry.vertices for it in self._bottoms.moving if isinstance(it.geometry, MeshGeometry)
        ]
        return self._run(lambda commands: self._bottoms.record_refits(commands, vertices))

    def top_seconds(self) -> float:
        """Build the upper level anew, and return the seconds, waited for."""
        return self._run(self._top.record)

    @property
    def bytes(self) -> int:
        """Bytes of the structures, of both levels and with what builds of the upper level need."""
        return self._bottoms.counts["ray_structure_bytes"] + self._top.bytes + self.orders.size

    def close(self) -> None:
        """Free the structures."""
        self._gpu.device.wait_idle()
        self._top.close()
        self._bottoms.close()
