"""The barriers around a copy into an image, and its queue family ownership transfer.

Queues of one family share their images. Between families the ownership of an image is transferred by two barriers: a
release on the source queue after the copy, and an acquisition on the destination queue before the first use. Both name
the same layouts and families, and the layout transition happens once. A semaphore orders the two submissions. With one
family, one barrier is enough, and it names no family.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import STATES

_COPY = STATES["copy_target"]
_SAMPLED = STATES["sampled"]


@dataclass(frozen=True)
class Part:
    """Some levels of one layer of an image."""

    image: Any
    aspect: int
    level: int
    levels: int
    layer: int = 0


def part_barrier(part: Part, before: str, after: str, *, discard: bool = False) -> Any:
    """Return a VkImageMemoryBarrier2 that takes a part from one state to another, as `barriers.image_barrier` does."""
    source, target = STATES[before], STATES[after]
    old = vk.VK_IMAGE_LAYOUT_UNDEFINED if discard else source.layout
    return _barrier(part, (source.stages, source.access), (target.stages, target.access), old, target.layout)


def before_copy(part: Part, held: bool) -> Any:
    """Return the barrier before the first copy; it discards the contents of the part.

    A new image needs no wait. One that is `held` (a layer of an array that frames have bound) waits for those frames.
    """
    return part_barrier(part, "sampled" if held else "undefined", "copy_target", discard=True)


def after_copy(part: Part, giver: int, taker: int) -> tuple[Any, Any]:
    """Return the barriers (release, acquire) after the last copy, from family `giver` to family `taker`.

    With one family it returns (barrier, None).
    """
    copied, read = (_COPY.stages, _COPY.access), (_SAMPLED.stages, _SAMPLED.access)
    layouts = (_COPY.layout, _SAMPLED.layout)
    if giver == taker:
        return _barrier(part, copied, read, *layouts), None
    families = (giver, taker)
    release = _barrier(part, copied, (vk.VK_PIPELINE_STAGE_2_NONE, 0), *layouts, families)
    # The submission waits at ALL_COMMANDS, so the layout transition follows the semaphore.
    acquire = _barrier(part, (vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, 0), read, *layouts, families)
    return release, acquire


def _barrier(
    part: Part,
    source: tuple[int, int],
    target: tuple[int, int],
    old: int,
    new: int,
    families: tuple[int, int] = (vk.VK_QUEUE_FAMILY_IGNORED, vk.VK_QUEUE_FAMILY_IGNORED),
) -> Any:
    return vk.new(
        "VkImageMemoryBarrier2",
        srcStageMask=source[0],
        srcAccessMask=source[1],
        dstStageMask=target[0],
        dstAccessMask=target[1],
        oldLayout=old,
        newLayout=new,
        srcQueueFamilyIndex=families[0],
        dstQueueFamilyIndex=families[1],
        image=part.image,
        subresourceRange={
            "aspectMask": part.aspect,
            "baseMipLevel": part.level,
            "levelCount": part.levels,
            "baseArrayLayer": part.layer,
            "layerCount": 1,
        },
    )
