"""GPU memory: a few large blocks per memory type, sub-allocated; large images get memory of their own.

Drivers allow as few as 4096 allocations and each costs tens of microseconds, so buffers and images share blocks.
Linear resources (buffers) and optimal ones (images) never share a block: then `bufferImageGranularity`, the distance
that some hardware wants between the two, cannot matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from backends.vulkan import api as vk
from common.errors import DeviceError
from common.numerics.allocators import BlockAllocator

if TYPE_CHECKING:
    from backends.vulkan.device import Device

MemoryUse = Literal["device", "upload", "readback"]

BLOCK_SIZE = 64 << 20
"""Bytes of a block: large enough that a scene needs few, small enough that the last one wastes little."""


@dataclass(frozen=True)
class MemoryType:
    """One memory type of the device: property flags and the size of its heap in bytes."""

    flags: int
    heap_size: int


def choose_memory_type(types: Sequence[MemoryType], allowed: int, use: MemoryUse) -> int:
    """Return the index of the memory type for `use` among those whose bit is set in `allowed`.

    The GPU's own memory for what only the GPU touches; coherent memory that the CPU can map for uploads, and rather
    not the small window into the GPU's memory; CPU-cached memory for readback, since uncached reads are slow by two
    orders of magnitude. Raises DeviceError if none fits.
    """
    local = vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
    visible = vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT
    coherent = vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT
    cached = vk.VK_MEMORY_PROPERTY_HOST_CACHED_BIT
    lazy = vk.VK_MEMORY_PROPERTY_LAZILY_ALLOCATED_BIT | vk.VK_MEMORY_PROPERTY_PROTECTED_BIT
    required = {"device": 0, "upload": visible | coherent, "readback": visible}[use]
    wanted = {"device": local, "upload": 0, "readback": cached}[use]
    liked = {"device": 0, "upload": 0, "readback": coherent}[use]  # of two that serve alike
    shunned = {"device": visible, "upload": local | cached, "readback": local}[use]
    best, best_score = -1, (-1, -1, -1)
    for index, kind in enumerate(types):
        if not allowed >> index & 1 or kind.flags & required != required or kind.flags & lazy:
            continue
        score = (
            (kind.flags & wanted == wanted) * 2 + (kind.flags & liked == liked),
            -(kind.flags & shunned).bit_count(),
            kind.heap_size,
        )
        if score > best_score:
            best, best_score = index, score
    if best < 0:
        raise DeviceError(f"The device has no memory type for {use} among {allowed:#x}.")
    return best


@dataclass
class Allocation:
    """A range of device memory; `mapped` is a (size,) uint8 view of it where the CPU can reach it, else None."""

    memory: Any
    offset: int
    size: int
    mapped: np.ndarray | None
    coherent: bool
    block: _Block


class _Block:
    """One `VkDeviceMemory`, mapped for good where it can be: mapping again and again costs more than it saves."""

    def __init__(self, device: Device, type_index: int, size: int, visible: bool, owner: Any = None) -> None:
        flags = vk.new(
            "VkMemoryAllocateFlagsInfo", flags=vk.VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT, pNext=owner
        )
        info = vk.new("VkMemoryAllocateInfo", allocationSize=size, memoryTypeIndex=type_index, pNext=flags)
        self.handle = device.create("vkAllocateMemory", info, f"memory type {type_index}, {size >> 10} KiB")
        self.size = size
        self.ranges = BlockAllocator(size)
        self.live = 0
        self.dedicated = owner is not None
        self.bytes: np.ndarray | None = None
        if visible:
            pointer = vk.ffi.new("void **")
            code = device.fn.vkMapMemory(device.handle, self.handle, 0, vk.VK_WHOLE_SIZE, 0, pointer)
            if code < 0:
                device.destroy("VkDeviceMemory", self.handle)
            vk.check(code, "vkMapMemory", self.handle)
            self.bytes = np.frombuffer(vk.ffi.buffer(pointer[0], size), np.uint8)


class MemoryAllocator:
    """Hands out ranges of device memory; `allocated` and `used` are in bytes."""

    def __init__(self, device: Device) -> None:
        self._device = device
        properties = vk.new("VkPhysicalDeviceMemoryProperties")
        device.instance.fn.vkGetPhysicalDeviceMemoryProperties(device.physical.handle, properties)
        self.types = [
            MemoryType(
                int(properties.memoryTypes[i].propertyFlags),
                int(properties.memoryHeaps[properties.memoryTypes[i].heapIndex].size),
            )
            for i in range(properties.memoryTypeCount)
        ]
        self._blocks: dict[tuple[int, bool], list[_Block]] = {}

    @property
    def allocated(self) -> int:
        """Bytes taken from the driver."""
        return sum(block.size for blocks in self._blocks.values() for block in blocks)

    def allocate(self, requirements: Any, use: MemoryUse, linear: bool, owner: Any = None) -> Allocation:
        """Return memory for a resource; `owner` is a VkMemoryDedicatedAllocateInfo if it should not share a block."""
        index = choose_memory_type(self.types, requirements.memoryTypeBits, use)
        kind = self.types[index]
        visible = bool(kind.flags & vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT) and (use != "device" or linear)
        size = int(requirements.size)
        # A block may be a large part of a small heap (the 256 MiB window of older GPUs): then take smaller ones.
        block_size = min(BLOCK_SIZE, max(kind.heap_size // 16, 1 << 20))
        blocks = self._blocks.setdefault((index, linear), [])
        if size > kind.heap_size:
            raise vk.VulkanError("vkAllocateMemory", vk.VK_ERROR_OUT_OF_DEVICE_MEMORY, (size,))
        if owner is not None or size > block_size // 2:
            block = _Block(self._device, index, size, visible, owner)
            blocks.append(block)
            block.live = 1
            block.ranges.alloc(size, 1)
            return self._allocation(block, 0, size, kind)
        alignment = int(requirements.alignment)
        for block in blocks:
            offset = block.ranges.alloc(size, alignment)
            if offset is not None:
                break
        else:
            block = _Block(self._device, index, block_size, visible)
            blocks.append(block)
            offset = block.ranges.alloc(size, alignment)
            assert offset is not None, "an empty block holds anything up to half its size"
        block.live += 1
        return self._allocation(block, offset, size, kind)

    @staticmethod
    def _allocation(block: _Block, offset: int, size: int, kind: MemoryType) -> Allocation:
        mapped = block.bytes[offset : offset + size] if block.bytes is not None else None
        coherent = bool(kind.flags & vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT)
        return Allocation(block.handle, offset, size, mapped, coherent, block)

    def free(self, allocation: Allocation) -> None:
        """Give a range back; an empty block then goes back to the driver, save the last one that can be shared."""
        block = allocation.block
        block.ranges.free(allocation.offset)
        block.live -= 1
        if block.live:
            return
        blocks = next(blocks for blocks in self._blocks.values() if block in blocks)
        # Dedicated memory belongs to one image for good: nothing else may be bound to it.
        if len(blocks) > 1 or block.size > BLOCK_SIZE or block.dedicated:
            blocks.remove(block)
            self._release(block)

    def invalidate(self, allocation: Allocation | None) -> None:
        """Make what the GPU wrote visible to the CPU; free of cost where the memory is coherent or not from here."""
        if allocation is None or allocation.coherent:
            return
        ranges = vk.array("VkMappedMemoryRange", [{"memory": allocation.memory, "size": vk.VK_WHOLE_SIZE}])
        code = self._device.fn.vkInvalidateMappedMemoryRanges(self._device.handle, 1, ranges)
        vk.check(code, "vkInvalidateMappedMemoryRanges")

    def _release(self, block: _Block) -> None:
        block.bytes = None
        self._device.destroy("VkDeviceMemory", block.handle)

    def close(self) -> None:
        """Give everything back; ranges that are still used belong to objects that the device then names."""
        for blocks in self._blocks.values():
            for block in blocks:
                self._release(block)
        self._blocks.clear()
