"""The barriers that hand an image over, as numbers: Vulkan's rules for the transfer of ownership, word for word."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from tools.exercises.checking import Given

GIVER, TAKER = 2, 0


def check(given: Given) -> None:
    """Compare release and acquire of one image, between two families and within one."""
    barriers: Any = given.module("loading.vulkan_barriers")
    part = barriers.Part(vk.NULL, vk.VK_IMAGE_ASPECT_COLOR_BIT, 1, 3, 2)
    release, acquire = barriers.after_copy(part, GIVER, TAKER)
    given.need(acquire is not None, "Between two families of queues there is no acquire.")
    for name, barrier in (("release", release), ("acquire", acquire)):
        families = (barrier.srcQueueFamilyIndex, barrier.dstQueueFamilyIndex)
        given.need(
            families == (GIVER, TAKER),
            f"Family {GIVER} gives an image to family {TAKER}, and the {name} says {families[0]} to {families[1]}.",
        )
        layouts = (barrier.oldLayout, barrier.newLayout)
        wanted = (vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL)
        given.need(
            layouts == wanted, f"The {name} changes layout {layouts[0]} to {layouts[1]}, not {wanted}."
        )
        given.need(
            _range(barrier) == (1, 3, 2, 1), f"The {name} is of other levels or layers than were copied."
        )
    given.need(release.srcAccessMask, "The release makes no write of the copy available.")
    given.need(acquire.dstAccessMask, "The acquire makes nothing visible to what reads the image.")
    single, none = barriers.after_copy(part, TAKER, TAKER)
    given.need(none is None, "Within one family there are two barriers where one does.")
    given.need(
        single.srcQueueFamilyIndex == single.dstQueueFamilyIndex,
        "Within one family a barrier names two: the image is given away.",
    )
    given.need(
        single.srcAccessMask and single.dstAccessMask,
        "Within one family the barrier orders no write of the copy before a read.",
    )


def _range(barrier: Any) -> tuple[int, int, int, int]:
    held = barrier.subresourceRange
    return held.baseMipLevel, held.levelCount, held.baseArrayLayer, held.layerCount
