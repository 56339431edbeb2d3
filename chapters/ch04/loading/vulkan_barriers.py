"""The barriers around a copy into an image, and those that hand it from one family of queues to another.

Queues of one family share what they have. Between families an image changes its owner, and for that the same barrier
is recorded twice: on the giver's queue, after the copy (release), and on the taker's, before the first use (acquire).
Both name the same layouts and families, and the layout changes once. A semaphore between the two submissions says
which comes first. Where there is one family, one barrier does both, and names none.
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
    """Return the barrier before the first copy: what the part held is given up.

    Of a new image nothing is waited for. One that is `held`, a layer of an array that frames draw with, was at least
    bound by those before.
    """
    return part_barrier(part, "sampled" if held else "undefined", "copy_target", discard=True)


def after_copy(part: Part, giver: int, taker: int) -> tuple[Any, Any]:
    """Return the barriers (release, acquire) after the last copy, by queues of the families `giver` and `taker`.

    With one family there is no second one: (barrier, None).
    """
    copied, read = (_COPY.stages, _COPY.access), (_SAMPLED.stages, _SAMPLED.access)
    layouts = (_COPY.layout, _SAMPLED.layout)
    if giver == taker:
        return _barrier(part, copied, read, *layouts), None
    families = (giver, taker)
    release = _barrier(part, copied, (vk.VK_PIPELINE_STAGE_2_NONE, 0), *layouts, families)
    # ALL_COMMANDS is what the submission waits at: the change of layout comes after the semaphore.
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
