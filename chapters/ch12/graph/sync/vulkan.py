"""The barriers of a frame graph as Vulkan structs: stages, accesses and layouts, one VkDependencyInfo for each pass.

The layout "read" differs between colour and depth. If a resource reuses memory that another one wrote, a memory barrier
is needed as well: an image barrier covers writes through its own image, not through the other image.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, Image

from ...frames.queues.vulkan_queues import Fields
from ..types import Barrier, Touch

STAGES: dict[str, int] = {
    "indirect": vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT,
    "vertex": vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT,
    "task": vk.VK_PIPELINE_STAGE_2_TASK_SHADER_BIT_EXT,
    "mesh": vk.VK_PIPELINE_STAGE_2_MESH_SHADER_BIT_EXT,
    "fragment": vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT,
    "compute": vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
    "color": vk.VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT,
    "depth": vk.VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | vk.VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT,
    "rate": vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADING_RATE_ATTACHMENT_BIT_KHR,
    "copy": vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
    "host": vk.VK_PIPELINE_STAGE_2_HOST_BIT,
    "build": vk.VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_BUILD_BIT_KHR,
    "rays": vk.VK_PIPELINE_STAGE_2_RAY_TRACING_SHADER_BIT_KHR,
}

ACCESS: dict[str, int] = {
    "color_read": vk.VK_ACCESS_2_COLOR_ATTACHMENT_READ_BIT,
    "color_write": vk.VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT,
    "depth_read": vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT,
    "depth_write": vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
    "sampled": vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT,
    "storage_read": vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT,
    "storage_write": vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
    "uniform": vk.VK_ACCESS_2_UNIFORM_READ_BIT,
    "indirect": vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT,
    "rate_read": vk.VK_ACCESS_2_FRAGMENT_SHADING_RATE_ATTACHMENT_READ_BIT_KHR,
    "copy_read": vk.VK_ACCESS_2_TRANSFER_READ_BIT,
    "copy_write": vk.VK_ACCESS_2_TRANSFER_WRITE_BIT,
    "host_read": vk.VK_ACCESS_2_HOST_READ_BIT,
    "build_input": vk.VK_ACCESS_2_SHADER_READ_BIT,
    "structure_read": vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_READ_BIT_KHR,
    "structure_write": vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_WRITE_BIT_KHR,
}

_LAYOUTS: dict[str, int] = {
    "undefined": vk.VK_IMAGE_LAYOUT_UNDEFINED,
    "color": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
    "depth": vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL,
    "read": vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL,
    "rate": vk.VK_IMAGE_LAYOUT_FRAGMENT_SHADING_RATE_ATTACHMENT_OPTIMAL_KHR,
    "general": vk.VK_IMAGE_LAYOUT_GENERAL,
    "copy_source": vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
    "copy_target": vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL,
}


def layout_of(word: str, image: Image) -> int:
    """Return the VkImageLayout of an image for a layout of the graph."""
    if word == "read" and image.aspect & vk.VK_IMAGE_ASPECT_DEPTH_BIT:
        # In this layout a shader may sample the depth that draws are tested against.
        return int(vk.VK_IMAGE_LAYOUT_DEPTH_READ_ONLY_OPTIMAL)
    return _LAYOUTS[word]


def dependency(planned: Iterable[Barrier], resources: Mapping[str, Image | Buffer], fields: Fields) -> Any:
    """Return one VkDependencyInfo for several barriers; None if there are none."""
    images, buffers, memory = [], [], []
    for barrier in planned:
        masks = _masks(barrier.before, barrier.after)
        if barrier.instead_of and barrier.before.writes:
            memory.append(masks)
        resource, common = resources.get(barrier.resource), fields(barrier, masks)
        if resource is None:  # parts of several buffers, which have no common object
            memory.append(masks)
            continue
        if isinstance(resource, Buffer):
            buffers.append({**common, "buffer": resource.handle, "size": vk.VK_WHOLE_SIZE})
            continue
        images.append(
            {
                **common,
                "oldLayout": layout_of("undefined" if barrier.discard else barrier.before.layout, resource),
                "newLayout": layout_of(barrier.after.layout, resource),
                "image": resource.handle,
                "subresourceRange": {
                    "aspectMask": resource.aspect,
                    "levelCount": vk.VK_REMAINING_MIP_LEVELS,
                    "layerCount": vk.VK_REMAINING_ARRAY_LAYERS,
                },
            }
        )
    if not (images or buffers or memory):
        return None
    return vk.new(
        "VkDependencyInfo",
        pImageMemoryBarriers=images or None,
        pBufferMemoryBarriers=buffers or None,
        pMemoryBarriers=memory or None,
    )


def _masks(before: Touch, after: Touch) -> dict[str, int]:
    """Return the source and destination scopes of a barrier: stages and accesses."""
    return {
        "srcStageMask": sum(STAGES[stage] for stage in before.stages),
        # Reads need no availability operation.
        "srcAccessMask": sum(ACCESS[access] for access in before.access) if before.writes else 0,
        "dstStageMask": sum(STAGES[stage] for stage in after.stages),
        "dstAccessMask": sum(ACCESS[access] for access in after.access),
    }
