"""What reading the GPU's results costs the CPU, by the kind of memory that they lie in.

Memory that both can reach comes in kinds. *Coherent* memory needs no call before the CPU reads what the GPU wrote;
where it is not also *cached*, every read goes over the bus, and numpy's copy runs at a small part of its speed.
*Cached* memory that is not coherent needs a call that drops stale lines, once for any number of bytes. A buffer of 21
MB, the size that the article "A Basic Vulkan Renderer" measures (61.9 ms against 3.8 ms there), is filled by the GPU
and copied from each kind of memory that the device has; the copies are compared.
"""

from __future__ import annotations

import statistics
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from common.reports.benches import Effort
from common.reports.tables import table

BYTES = 21 * 10**6
"""Of a copy; a multiple of four."""

FLAGS = {
    "device-local": vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
    "coherent": vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
    "cached": vk.VK_MEMORY_PROPERTY_HOST_CACHED_BIT,
}
"""What kinds of memory that the CPU can map differ in."""

PATTERN = 0x9E3779B9


@dataclass(frozen=True)
class Kind:
    """A kind of memory that the CPU can map: the first type of the device with these FLAGS, and their names."""

    index: int
    flags: tuple[str, ...]

    @property
    def name(self) -> str:
        """The flags in words."""
        return ", ".join(self.flags) or "visible alone"


def kinds(device: Device, allowed: int) -> list[Kind]:
    """Return the kinds of memory that the CPU can map, of the types whose bits `allowed` has."""
    found: dict[tuple[str, ...], int] = {}
    for index, kind in enumerate(device.memory.types):
        if allowed >> index & 1 and kind.flags & vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT:
            flags = tuple(name for name, bit in FLAGS.items() if kind.flags & bit)
            found.setdefault(flags, index)
    return [Kind(index, flags) for flags, index in found.items()]


def measure(
    device: Device, effort: Effort, step: Callable[[str, float], None], size: int = BYTES
) -> dict[str, Any]:
    """Return ms and GB/s of copying `size` bytes out of each kind of memory, and which one readbacks take."""
    info = vk.new("VkBufferCreateInfo", size=size, usage=vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT)
    probe = device.create("vkCreateBuffer", info, "memory kinds")
    needs = vk.new("VkMemoryRequirements")
    device.fn.vkGetBufferMemoryRequirements(device.handle, probe, needs)
    device.destroy("VkBuffer", probe)
    found = kinds(device, needs.memoryTypeBits)
    points: list[dict[str, Any]] = []
    for number, kind in enumerate(found):
        step(kind.name, number / len(found))
        with _Filled(device, info, kind, needs) as filled:
            times = [filled.copy() for _ in range(max(3, effort.rounds))][
                1:
            ]  # the first pays for page faults
        took = statistics.median(times)
        points.append({"kind": kind.name, "ms": took, "gb_per_s": size / took / 1e6, "same": filled.same})
    slowest = max(point["ms"] for point in points)
    for point in points:
        point["times_faster"] = slowest / point["ms"]
    return {"bytes": size, "points": points}


class _Filled:
    """A buffer in one kind of memory that the GPU has written, mapped."""

    def __init__(self, device: Device, info: Any, kind: Kind, needs: Any) -> None:
        self._device, self.same = device, True
        self._buffer = device.create("vkCreateBuffer", info, kind.name)
        ask = vk.new("VkMemoryAllocateInfo", allocationSize=needs.size, memoryTypeIndex=kind.index)
        self._memory = device.create("vkAllocateMemory", ask, kind.name)
        code = device.fn.vkBindBufferMemory(device.handle, self._buffer, self._memory, 0)
        vk.check(code, "vkBindBufferMemory")
        pointer = vk.ffi.new("void **")
        code = device.fn.vkMapMemory(device.handle, self._memory, 0, vk.VK_WHOLE_SIZE, 0, pointer)
        vk.check(code, "vkMapMemory")
        self._bytes = np.frombuffer(vk.ffi.buffer(pointer[0], info.size), np.uint32)
        self._ranges = vk.array("VkMappedMemoryRange", [{"memory": self._memory, "size": vk.VK_WHOLE_SIZE}])
        self._coherent = "coherent" in kind.flags
        self._turn = 0

    def copy(self) -> float:
        """Have the GPU write the buffer anew and copy it out; return the ms of that copy, with what must precede it."""
        device = self._device
        self._turn += 1
        value = PATTERN * self._turn & 0xFFFFFFFF
        with submit_once(device) as commands:
            device.fn.vkCmdFillBuffer(commands, self._buffer, 0, vk.VK_WHOLE_SIZE, value)
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
        began = clock.perf_counter()
        if not self._coherent:
            code = device.fn.vkInvalidateMappedMemoryRanges(device.handle, 1, self._ranges)
            vk.check(code, "vkInvalidateMappedMemoryRanges")
        copied = self._bytes.copy()
        took = (clock.perf_counter() - began) * 1e3
        self.same = self.same and bool((copied == value).all())
        return took

    def __enter__(self) -> _Filled:
        return self

    def __exit__(self, *_: object) -> None:
        self._device.destroy("VkBuffer", self._buffer)
        self._device.destroy("VkDeviceMemory", self._memory)


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table."""
    shown = table(
        f"Copying {made['bytes'] / 1e6:.0f} MB that the GPU wrote", "memory", ">ms", ">GB/s", ">times faster"
    )
    for point in made["points"]:
        shown.add_row(
            point["kind"],
            f"{point['ms']:.2f}",
            f"{point['gb_per_s']:.2f}",
            f"{point['times_faster']:.1f}",
        )
    to.print(shown)
    if len(made["points"]) == 1:
        to.print("This device has one kind of memory that the CPU can map: nothing to compare.")
