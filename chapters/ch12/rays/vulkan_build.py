"""Acceleration structures of meshes on Vulkan: built together, compacted, and refitted.

A bottom-level structure (BLAS) holds the triangles of one mesh. The driver says how much memory a build takes: that of
the structure, and *scratch* memory that only the build uses. One call builds many structures, and the GPU may build
them at the same time, so each has scratch memory of its own. All of them together could take too much: they are built
in batches, each within a budget.

The size is an upper bound that the driver knows before the build. Afterwards a query tells the size that is really
needed, and a copy in the mode COMPACT has just that. A structure that is refitted is not compacted: it is updated in
place, with scratch memory of its own that it keeps.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer

from .vulkan_geometry import Geometry

BUILD = vk.VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_BUILD_BIT_KHR
READ = vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_READ_BIT_KHR
WRITE = vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_WRITE_BIT_KHR

BUILD_AFTER_BUILD = barriers(memory=(BUILD, READ | WRITE, BUILD, READ | WRITE))
"""A build reads or replaces what an earlier one wrote; scratch memory counts as the structure's."""

INPUT = (
    vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR
    | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
)
"""The usage of a buffer that builds read."""

PLACE = 256
"""Structures begin at multiples of so many bytes (VkAccelerationStructureCreateInfoKHR, VUID 03734)."""

_STORAGE = (
    vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
)
_SCRATCH = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
_BOTTOM = vk.VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
_NEW = vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR
_AGAIN = vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR


@dataclass(frozen=True)
class Budget:
    """The most that one batch of builds takes, unless a single mesh takes more.

    `scratch` and `storage` are bytes. `triangles` bounds the time of a submission: the software driver builds ten
    million a second, and no submission shall take half a second.
    """

    scratch: int = 64 << 20
    storage: int = 256 << 20
    triangles: int = 2_000_000


DEFAULT = Budget()


@dataclass(frozen=True)
class StructureLimits:
    """The numbers of a device that structures depend on."""

    scratch_alignment: int
    most_triangles: int
    most_instances: int

    @classmethod
    def of(cls, device: Device) -> StructureLimits:
        """Return the numbers of a device."""
        limits = vk.new("VkPhysicalDeviceAccelerationStructurePropertiesKHR")
        properties = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
        device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
        return cls(
            int(limits.minAccelerationStructureScratchOffsetAlignment),
            int(limits.maxPrimitiveCount),
            int(limits.maxInstanceCount),
        )


@dataclass(frozen=True)
class Sizes:
    """What a structure takes, in bytes: itself, scratch memory of a build, and of an update."""

    structure: int
    scratch: int
    update: int


def build_info(kind: int, flags: int, geometry: dict[str, Any]) -> Any:
    """Return a VkAccelerationStructureBuildGeometryInfoKHR of one geometry, for a new structure."""
    return vk.new(
        "VkAccelerationStructureBuildGeometryInfoKHR",
        type=kind,
        flags=flags,
        mode=_NEW,
        pGeometries=[geometry],
        geometryCount=1,
    )


def sizes_of(device: Device, info: Any, count: int) -> Sizes:
    """Return what a structure of `count` triangles or instances takes."""
    sizes = vk.new("VkAccelerationStructureBuildSizesInfoKHR")
    by_device = vk.VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR
    counts = vk.array("uint32_t", [count])
    device.fn.vkGetAccelerationStructureBuildSizesKHR(device.handle, by_device, info, counts, sizes)
    return Sizes(
        int(sizes.accelerationStructureSize), int(sizes.buildScratchSize), int(sizes.updateScratchSize)
    )


def create_structure(
    device: Device, kind: int, buffer: Buffer, offset: int, size: int, name: str
) -> tuple[Any, int]:
    """Return a structure in a part of a buffer, and its address; nothing is built."""
    info = vk.new(
        "VkAccelerationStructureCreateInfoKHR", buffer=buffer.handle, offset=offset, size=size, type=kind
    )
    handle = device.create("vkCreateAccelerationStructureKHR", info, name)
    asked = vk.new("VkAccelerationStructureDeviceAddressInfoKHR", accelerationStructure=handle)
    return handle, int(device.fn.vkGetAccelerationStructureDeviceAddressKHR(device.handle, asked))


def record_builds(device: Device, commands: Any, infos: Sequence[Any], counts: Sequence[int]) -> None:
    """Record one call that builds several structures, which may run at the same time."""
    ranges = [vk.new("VkAccelerationStructureBuildRangeInfoKHR", primitiveCount=count) for count in counts]
    pointers = vk.array("VkAccelerationStructureBuildRangeInfoKHR *", ranges)
    array = vk.array("VkAccelerationStructureBuildGeometryInfoKHR", infos)
    device.fn.vkCmdBuildAccelerationStructuresKHR(commands, len(infos), array, pointers)


def storage_buffer(device: Device, size: int, name: str) -> Buffer:
    """Return a buffer for structures."""
    return create_buffer(device, size, _STORAGE, "device", name)


class Scratch:
    """Scratch memory in parts that begin where the device wants it."""

    def __init__(self, device: Device, sizes: Sequence[int], name: str) -> None:
        self._device = device
        alignment = StructureLimits.of(device).scratch_alignment
        offsets, end = places(sizes, alignment)
        self.buffer = create_buffer(device, end + alignment, _SCRATCH, "device", name)
        start = up(buffer_address(device, self.buffer), alignment)
        self.addresses = [start + offset for offset in offsets]

    def close(self) -> None:
        """Free the memory; no build uses it."""
        destroy_buffer(self._device, self.buffer)


def up(size: int, alignment: int) -> int:
    """Return the least multiple of `alignment` that is not below `size`."""
    return -(-size // alignment) * alignment


def places(sizes: Sequence[int], alignment: int) -> tuple[list[int], int]:
    """Return the offset of each part, a multiple of `alignment`, and the size of all."""
    offsets, end = [], 0
    for size in sizes:
        offsets.append(end)
        end += up(size, alignment)
    return offsets, end


def batches(sizes: Sequence[Sizes], counts: Sequence[int], budget: Budget) -> Iterator[range]:
    """Yield ranges of structures that are built together: as many as the budget has room for, at least one."""
    first, scratch, storage, triangles = 0, 0, 0, 0
    for number, (size, count) in enumerate(zip(sizes, counts, strict=True)):
        scratch, storage, triangles = scratch + size.scratch, storage + size.structure, triangles + count
        over = scratch > budget.scratch or storage > budget.storage or triangles > budget.triangles
        if over and number > first:
            yield range(first, number)
            first, scratch, storage, triangles = number, size.scratch, size.structure, count
    if len(sizes) > first:
        yield range(first, len(sizes))


@dataclass
class Bottom:
    """A structure of a mesh that was built: its handle, its address, and what it takes."""

    geometry: Geometry
    handle: Any
    address: int
    size: int
    built_size: int
    """Bytes before compaction."""
    update: int = 0
    """Bytes of scratch memory of a refit."""


class Bottoms:
    """The structures of meshes, built when this object is created. `counts` has counters for `frame.work`."""

    def __init__(
        self,
        device: Device,
        geometries: Sequence[Geometry],
        budget: Budget = DEFAULT,
        rebuilds: bool = False,
    ) -> None:
        """Build all; with `rebuilds` the scratch memory of refits is enough to build anew."""
        self._device, self._rebuilds = device, rebuilds
        self._buffers: list[Buffer] = []
        self.all: list[Bottom] = []
        self.calls = 0
        """Calls that built structures."""
        self._scratch: Scratch | None = None
        try:
            # Those that are refitted stay where they were built, and share no buffer with those that move.
            still = self._build([it for it in geometries if not it.refits], budget, True)
            moving = self._build([it for it in geometries if it.refits], budget, False)
            own = {id(it.geometry): it for it in (*still, *moving)}
            self.all = [own[id(geometry)] for geometry in geometries]
            self.moving = [it for it in self.all if it.geometry.refits]
            if self.moving:
                self._scratch = Scratch(device, [it.update for it in self.moving], "scratch of refits")
        except BaseException:
            self.close()
            raise

    def _build(self, geometries: Sequence[Geometry], budget: Budget, compacts: bool) -> list[Bottom]:
        infos = [build_info(_BOTTOM, it.flags, it.info()) for it in geometries]
        sizes = [sizes_of(self._device, info, it.count) for info, it in zip(infos, geometries, strict=True)]
        counts = [it.count for it in geometries]
        built: list[Bottom] = []
        for batch in batches(sizes, counts, budget):
            some = self._batch(
                [geometries[place] for place in batch],
                [infos[place] for place in batch],
                [sizes[place] for place in batch],
                compacts,
            )
            built += some
        return built

    def _batch(
        self, geometries: Sequence[Geometry], infos: Sequence[Any], sizes: Sequence[Sizes], compacts: bool
    ) -> list[Bottom]:
        device, counts = self._device, [it.count for it in geometries]
        built = self._placed(geometries, [size.structure for size in sizes], "structures")
        scratch = Scratch(device, [size.scratch for size in sizes], "scratch of builds")
        try:
            for info, it, size, address in zip(infos, built, sizes, scratch.addresses, strict=True):
                info.dstAccelerationStructure, it.update = it.handle, size.update
                if self._rebuilds:
                    it.update = max(size.update, size.scratch)
                info.scratchData.deviceAddress = address
            with self._sizes_query(len(built)) as query:
                with submit_once(device) as commands:
                    record_builds(device, commands, infos, counts)
                    self.calls += 1
                    if compacts:
                        self._ask(commands, query, built)
                if compacts:
                    return self._compacted(built, self._answers(query, len(built)))
        finally:
            scratch.close()
        return built

    def _placed(self, geometries: Sequence[Geometry], sizes: Sequence[int], name: str) -> list[Bottom]:
        """Return structures of these sizes in one buffer, not built."""
        device = self._device
        offsets, end = places(sizes, PLACE)
        buffer = storage_buffer(device, end, name)
        self._buffers.append(buffer)
        placed = []
        for geometry, offset, size in zip(geometries, offsets, sizes, strict=True):
            handle, address = create_structure(device, _BOTTOM, buffer, offset, size, geometry.name)
            placed.append(Bottom(geometry, handle, address, size, size))
            self.all.append(placed[-1])  # before anything can fail: `close` frees it
        return placed

    # --- compaction ---

    @contextmanager
    def _sizes_query(self, count: int) -> Iterator[Any]:
        info = vk.new(
            "VkQueryPoolCreateInfo",
            queryType=vk.VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
            queryCount=count,
        )
        pool = self._device.create("vkCreateQueryPool", info, "compacted sizes")
        try:
            yield pool
        finally:
            self._device.destroy("VkQueryPool", pool)

    def _ask(self, commands: Any, query: Any, built: Sequence[Bottom]) -> None:
        fn = self._device.fn
        fn.vkCmdPipelineBarrier2(commands, BUILD_AFTER_BUILD)
        fn.vkCmdResetQueryPool(commands, query, 0, len(built))
        handles = vk.array("VkAccelerationStructureKHR", [it.handle for it in built])
        kind = vk.VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR
        fn.vkCmdWriteAccelerationStructuresPropertiesKHR(commands, len(built), handles, kind, query, 0)

    def _answers(self, query: Any, count: int) -> list[int]:
        sizes = np.zeros(count, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        code = self._device.fn.vkGetQueryPoolResults(
            self._device.handle, query, 0, count, sizes.nbytes, vk.ffi.from_buffer(sizes), 8, flags
        )
        vk.check(code, "vkGetQueryPoolResults")
        return [int(size) for size in sizes]

    def _compacted(self, built: list[Bottom], sizes: Sequence[int]) -> list[Bottom]:
        """Return copies of their real sizes, if those are smaller; the originals are freed then."""
        device, before = self._device, self._buffers[-1]
        if places(sizes, PLACE)[1] >= places([it.size for it in built], PLACE)[1]:
            return built
        copies = self._placed([it.geometry for it in built], sizes, "compacted structures")
        with submit_once(device) as commands:
            for it, copy in zip(built, copies, strict=True):
                info = vk.new(
                    "VkCopyAccelerationStructureInfoKHR",
                    src=it.handle,
                    dst=copy.handle,
                    mode=vk.VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR,
                )
                device.fn.vkCmdCopyAccelerationStructureKHR(commands, info)
                copy.built_size = it.size
            # Builds of the upper level come in other submissions, and read them.
            device.fn.vkCmdPipelineBarrier2(commands, BUILD_AFTER_BUILD)
        for it in built:
            self.all.remove(it)
            device.destroy("VkAccelerationStructureKHR", it.handle)
        self._buffers.remove(before)
        destroy_buffer(device, before)
        return copies

    # --- refits ---

    def record_refits(self, commands: Any, vertices: Sequence[int], anew: Collection[int] = ()) -> None:
        """Record one call that fits the moving structures to their vertices at these addresses, in their order.

        Those at the places `anew` are built anew.
        """
        if self._scratch is None:
            return
        infos = []
        every = zip(self.moving, vertices, self._scratch.addresses, strict=True)
        for place, (it, address, scratch) in enumerate(every):
            info = build_info(_BOTTOM, it.geometry.flags, it.geometry.info(address))
            info.dstAccelerationStructure = it.handle
            if place not in anew:
                info.mode, info.srcAccelerationStructure = _AGAIN, it.handle
            info.scratchData.deviceAddress = scratch
            infos.append(info)
        record_builds(self._device, commands, infos, [it.geometry.count for it in self.moving])

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Structures, calls that built them, and bytes: now, and what they would take without compaction."""
        scratch = self._scratch.buffer.size if self._scratch else 0
        return {
            "ray_structures": len(self.all),
            "ray_build_calls": self.calls,
            "ray_structure_bytes": sum(buffer.size for buffer in self._buffers) + scratch,
            "ray_compacted_bytes": sum(it.size for it in self.all if not it.geometry.refits),
            "ray_uncompacted_bytes": sum(it.built_size for it in self.all if not it.geometry.refits),
        }

    def close(self) -> None:
        """Free everything; no frame in flight uses it."""
        for it in self.all:
            self._device.destroy("VkAccelerationStructureKHR", it.handle)
        for buffer in self._buffers:
            destroy_buffer(self._device, buffer)
        if self._scratch is not None:
            self._scratch.close()
        self.all, self._buffers, self._scratch = [], [], None
