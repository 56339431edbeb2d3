"""Machines that do not exist: devices described as a driver would, for tests of what is chosen among them."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.driver import features as vf
from backends.vulkan.instance import PhysicalDevice, QueueFamily

GRAPHICS, COMPUTE, TRANSFER, SPARSE = (
    vk.VK_QUEUE_GRAPHICS_BIT,
    vk.VK_QUEUE_COMPUTE_BIT,
    vk.VK_QUEUE_TRANSFER_BIT,
    vk.VK_QUEUE_SPARSE_BINDING_BIT,
)
ALL_BITS = frozenset(bit for requirement in (vf.FLOOR, *vf.OPTIONAL.values()) for bit in requirement.bits)
ALL_PROPERTIES = frozenset(name for requirement in vf.OPTIONAL.values() for name in requirement.properties)
ALL_EXTENSIONS = frozenset(name for requirement in vf.OPTIONAL.values() for name in requirement.extensions)


def families(*flags: int) -> tuple[QueueFamily, ...]:
    """Return queue families with these flags, in this order."""
    return tuple(QueueFamily(index, some, 1, 64) for index, some in enumerate(flags))


def described(name: str = "card", kind: Any = "discrete", **changes: Any) -> PhysicalDevice:
    """Return a device that has everything, save for `changes`."""
    limits = vk.new("VkPhysicalDeviceLimits")
    made: dict[str, Any] = {
        "handle": None,
        "index": 0,
        "name": name,
        "driver": "driver of nobody",
        "kind": kind,
        "version": (1, 3, 0),
        "extensions": ALL_EXTENSIONS,
        "bits": ALL_BITS,
        "properties": ALL_PROPERTIES,
        "families": families(GRAPHICS | COMPUTE | SPARSE),
        "limits": limits,
        "cache_uuid": "",
    }
    return PhysicalDevice(**{**made, **changes})
