"""The upper level on Vulkan (TLAS): a structure over instances, built anew from their records when one has moved.

A record names the structure of a mesh and its place in the world (VkAccelerationStructureInstanceKHR). A kernel writes
them (rays/vulkan_records.comp) in the order of a table, which exists once for each slot of frames, since the CPU writes
it. Records, structure and scratch memory exist once: builds and traces of successive frames follow one another on one
queue, with a barrier between them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer

from ..frames.frame import SLOTS
from .vulkan_build import (
    BUILD,
    INPUT,
    READ,
    WRITE,
    Scratch,
    build_info,
    create_structure,
    record_builds,
    sizes_of,
    storage_buffer,
)

RECORD_BYTES = 64
_TOP = vk.VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
_FAST = vk.VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
_COMPUTE = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT


class TopLevel:
    """The structure over `count` instances, with the records and tables that it is built from."""

    def __init__(self, device: Device, count: int) -> None:
        self._device, self.count = device, count
        self._owned: list[Buffer] = []
        self.handle: Any = None
        self._scratch: Scratch | None = None
        try:
            storage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
            copied = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
            size = max(1, count) * RECORD_BYTES
            self.records = self._buffer(size, storage | INPUT | copied, "device", "records")
            self.tables = [
                self._buffer(max(1, count) * 16, storage, "upload", f"table of instances, slot {slot}")
                for slot in range(SLOTS)
            ]
            data = {
                "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                "data": {"deviceAddress": buffer_address(device, self.records)},
            }
            geometry = {
                "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                "geometryType": vk.VK_GEOMETRY_TYPE_INSTANCES_KHR,
                "geometry": {"instances": data},
            }
            self._info = build_info(_TOP, _FAST, geometry)
            sizes = sizes_of(device, self._info, count)
            self._storage = storage_buffer(device, sizes.structure, "upper level")
            self._owned.append(self._storage)
            self.handle, _ = create_structure(device, _TOP, self._storage, 0, sizes.structure, "upper level")
            self._scratch = Scratch(device, [sizes.scratch], "scratch of the upper level")
            self._info.dstAccelerationStructure = self.handle
            self._info.scratchData.deviceAddress = self._scratch.addresses[0]
        except BaseException:
            self.close()
            raise

    def _buffer(self, size: int, usage: int, use: Any, name: str) -> Buffer:
        buffer = create_buffer(self._device, size, usage, use, f"rays: {name}")
        self._owned.append(buffer)
        return buffer

    @property
    def bytes(self) -> int:
        """Bytes of all its buffers."""
        return sum(buffer.size for buffer in self._owned) + (
            self._scratch.buffer.size if self._scratch else 0
        )

    def write_table(self, slot: int, table: NDArray[np.uint32]) -> int:
        """Write the table of a slot, which no frame in flight uses; return the bytes."""
        self.tables[slot].view(np.uint32)[: table.size] = table.reshape(-1)
        return int(table.nbytes)

    def record(self, commands: Any) -> None:
        """Record the build."""
        record_builds(self._device, commands, [self._info], [self.count])

    def close(self) -> None:
        """Free everything; no frame in flight uses it."""
        if self.handle is not None:
            self._device.destroy("VkAccelerationStructureKHR", self.handle)
            self.handle = None
        if self._scratch is not None:
            self._scratch.close()
            self._scratch = None
        for buffer in self._owned:
            destroy_buffer(self._device, buffer)
        self._owned = []


def tracing(device: Device) -> int:
    """Return the stages in which rays are traced on a device."""
    stages: int = _COMPUTE
    if device.has("ray-tracing"):
        stages |= vk.VK_PIPELINE_STAGE_2_RAY_TRACING_SHADER_BIT_KHR
    return stages


class Waits:
    """The barriers around the builds of a frame."""

    def __init__(self, device: Device) -> None:
        traces = tracing(device)
        records = vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
        self.before = barriers(
            memory=(traces | BUILD, READ | WRITE, _COMPUTE | BUILD, records | READ | WRITE)
        )
        """Earlier frames have traced through what is built anew, and read the records."""
        self.between = barriers(
            memory=(
                _COMPUTE | BUILD,
                records | WRITE,
                BUILD,
                vk.VK_ACCESS_2_SHADER_READ_BIT | READ | WRITE,
            )
        )
        """The upper level is built from records and from structures that have been refitted."""
        self.after = barriers(memory=(BUILD, WRITE, traces, READ))
        """Rays are traced through what was built."""
