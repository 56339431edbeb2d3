"""Makes on Vulkan what a creation descriptor describes; `backends.creation` says when to write one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.creation import BufferCreation, ImageCreation, SamplerCreation
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS, Buffer, Image, create_buffer, create_image, create_sampler
from common.errors import UserError

BUFFER_USAGES: dict[str, int] = {
    "copy_source": vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
    "copy_target": vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT,
    "uniform": vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT,
    "storage": vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
    "vertex": vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT,
    "index": vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
    "indirect": vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT,
    "address": vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
}
IMAGE_USAGES: dict[str, int] = {
    "copy_source": vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
    "copy_target": vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT,
    "sampled": vk.VK_IMAGE_USAGE_SAMPLED_BIT,
    "storage": vk.VK_IMAGE_USAGE_STORAGE_BIT,
    "color": vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
    "depth": vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
}


def buffer_from(device: Device, creation: BufferCreation) -> Buffer:
    """Return the buffer that is described; UserError where no use is, since Vulkan makes none without."""
    usage = _usage(creation, BUFFER_USAGES)
    return create_buffer(
        device, creation.size, usage, creation.memory, creation.name, creation.place, creation.families
    )


def image_from(device: Device, creation: ImageCreation) -> Image:
    """Return the image that is described; UserError where no use is, or for what `ImageCreation.check` refuses."""
    creation.check(FORMATS)
    shape, layers = creation.shape, creation.layers
    cubes = shape in ("cube", "cube_array")
    return create_image(
        device,
        creation.format,
        creation.size,
        _usage(creation, IMAGE_USAGES),
        creation.name,
        levels=creation.levels,
        layers=6 if shape == "cube" else 1 if shape == "3d" else layers,
        flags=vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT if cubes else 0,
        samples=creation.samples,
        array=shape == "array",
        depth=layers if shape == "3d" else None,
        view_format=creation.view_format,
        swizzle=creation.swizzle,
        place=creation.place,
    )


def sampler_from(device: Device, creation: SamplerCreation) -> Any:
    """Return the VkSampler that is described."""
    return create_sampler(device, creation.sampler, creation.anisotropy, creation.name)


def _usage(creation: BufferCreation | ImageCreation, bits: Mapping[str, int]) -> int:
    if not creation.uses:
        raise UserError(
            f"{type(creation).__name__} '{creation.name}' says no use, and Vulkan must know them all: "
            f"set_uses takes {', '.join(bits)}."
        )
    usage = 0
    for use in creation.uses:
        usage |= bits[use]
    return usage
