"""Image layouts and the accesses that go with them, in the words that passes use: one table, one barrier function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Image


@dataclass(frozen=True)
class State:
    """What an image is ready for: its layout, the stages that may touch it, and how."""

    layout: int
    stages: int
    access: int


_ANY_SHADER = (
    vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT
    | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT
    | vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT
)
_DEPTH_STAGES = (
    vk.VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | vk.VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT
)

STATES: dict[str, State] = {
    "undefined": State(vk.VK_IMAGE_LAYOUT_UNDEFINED, vk.VK_PIPELINE_STAGE_2_NONE, 0),
    "color": State(
        vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
        vk.VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT,
        vk.VK_ACCESS_2_COLOR_ATTACHMENT_READ_BIT | vk.VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT,
    ),
    "depth": State(
        vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL,
        _DEPTH_STAGES,
        vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT | vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
    ),
    "sampled": State(
        vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL, _ANY_SHADER, vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT
    ),
    "storage": State(
        vk.VK_IMAGE_LAYOUT_GENERAL,
        _ANY_SHADER,
        vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
    ),
    "copy_source": State(
        vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
        vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
        vk.VK_ACCESS_2_TRANSFER_READ_BIT,
    ),
    "copy_target": State(
        vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL,
        vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
        vk.VK_ACCESS_2_TRANSFER_WRITE_BIT,
    ),
    "present": State(vk.VK_IMAGE_LAYOUT_PRESENT_SRC_KHR, vk.VK_PIPELINE_STAGE_2_NONE, 0),
}
"""Each state's name with its layout, stages and accesses (Vulkan specification, "Synchronization")."""


def image_barrier(
    image: Any,
    aspect: int,
    before: str,
    after: str,
    level: int = 0,
    levels: int | None = None,
    *,
    discard: bool = False,
) -> Any:
    """Return a VkImageMemoryBarrier2 that takes an image from one state to another; KeyError for an unknown state.

    With `discard` the content is given up, which works from any layout; `before` then only says what to wait for.
    """
    source, target = STATES[before], STATES[after]
    return vk.new(
        "VkImageMemoryBarrier2",
        srcStageMask=source.stages,
        srcAccessMask=source.access,
        dstStageMask=target.stages,
        dstAccessMask=target.access,
        oldLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED if discard else source.layout,
        newLayout=target.layout,
        srcQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
        dstQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
        image=image,
        subresourceRange={
            "aspectMask": aspect,
            "baseMipLevel": level,
            "levelCount": vk.VK_REMAINING_MIP_LEVELS if levels is None else levels,
            "layerCount": vk.VK_REMAINING_ARRAY_LAYERS,
        },
    )


def barriers(*images: Any, memory: tuple[int, int, int, int] | None = None) -> Any:
    """Return a VkDependencyInfo for `vkCmdPipelineBarrier2`, to be made once and used every frame.

    `memory` is (source stages, source access, target stages, target access) of a barrier for all buffers.
    """
    plain = None
    if memory is not None:
        names = ("srcStageMask", "srcAccessMask", "dstStageMask", "dstAccessMask")
        plain = [dict(zip(names, memory, strict=True))]
    return vk.new("VkDependencyInfo", pImageMemoryBarriers=list(images) or None, pMemoryBarriers=plain)


def transition(device: Device, commands: Any, image: Image, before: str, after: str) -> None:
    """Record one barrier for all of `image`: for loading and tests, where nothing is made ahead."""
    dependency = barriers(image_barrier(image.handle, image.aspect, before, after))
    device.fn.vkCmdPipelineBarrier2(commands, dependency)
