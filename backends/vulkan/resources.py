"""Buffers, images, views and samplers: each with its memory, a name, and one call to make and one to free it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.memory import Allocation, MemoryUse
from common.errors import DeviceError, UnsupportedError
from common.images import blocks
from common.scene import Sampler

# Short names of formats, as passes declare them: (Vulkan's constant, bytes of a texel, numpy type, channels);
# of the formats of `common.images.blocks` the bytes are those of a block of 4x4 texels.
FORMATS: dict[str, tuple[int, int, type, int]] = {
    "r8": (vk.VK_FORMAT_R8_UNORM, 1, np.uint8, 1),
    "rg8": (vk.VK_FORMAT_R8G8_UNORM, 2, np.uint8, 2),
    "rgba8": (vk.VK_FORMAT_R8G8B8A8_UNORM, 4, np.uint8, 4),
    "rgba8_srgb": (vk.VK_FORMAT_R8G8B8A8_SRGB, 4, np.uint8, 4),
    "rgb10a2": (vk.VK_FORMAT_A2B10G10R10_UNORM_PACK32, 4, np.uint32, 1),
    "r8ui": (vk.VK_FORMAT_R8_UINT, 1, np.uint8, 1),
    "r32ui": (vk.VK_FORMAT_R32_UINT, 4, np.uint32, 1),
    "rg32ui": (vk.VK_FORMAT_R32G32_UINT, 8, np.uint32, 2),
    "r32f": (vk.VK_FORMAT_R32_SFLOAT, 4, np.float32, 1),
    "rg16f": (vk.VK_FORMAT_R16G16_SFLOAT, 4, np.float16, 2),
    "rgba16f": (vk.VK_FORMAT_R16G16B16A16_SFLOAT, 8, np.float16, 4),
    "rgba32f": (vk.VK_FORMAT_R32G32B32A32_SFLOAT, 16, np.float32, 4),
    "d32f": (vk.VK_FORMAT_D32_SFLOAT, 4, np.float32, 1),
    "bc4": (vk.VK_FORMAT_BC4_UNORM_BLOCK, 8, np.uint8, 1),
    "bc5": (vk.VK_FORMAT_BC5_UNORM_BLOCK, 16, np.uint8, 2),
    "bc7": (vk.VK_FORMAT_BC7_UNORM_BLOCK, 16, np.uint8, 4),
    "bc7_srgb": (vk.VK_FORMAT_BC7_SRGB_BLOCK, 16, np.uint8, 4),
    "etc2": (vk.VK_FORMAT_ETC2_R8G8B8_UNORM_BLOCK, 8, np.uint8, 4),
    "etc2_srgb": (vk.VK_FORMAT_ETC2_R8G8B8_SRGB_BLOCK, 8, np.uint8, 4),
}


@dataclass(eq=False)
class Buffer:
    """A buffer; `mapped` is (size,) uint8 where the CPU can reach it."""

    handle: Any
    size: int
    allocation: Allocation | None  # None: the memory belongs to another object
    name: str

    @property
    def mapped(self) -> np.ndarray:
        """The buffer's bytes; ValueError for memory that only the GPU reaches."""
        if self.allocation is None or self.allocation.mapped is None:
            raise ValueError(f"The buffer '{self.name}' is in memory that the CPU cannot map.")
        return self.allocation.mapped[: self.size]

    def view(self, dtype: Any) -> np.ndarray:
        """Return the mapped bytes as an array of `dtype`."""
        itemsize = np.dtype(dtype).itemsize
        return self.mapped[: self.size // itemsize * itemsize].view(dtype)


@dataclass(eq=False)
class Image:
    """An image with a view of all of it; `views` holds the others that were asked for."""

    handle: Any
    view: Any
    format: str
    width: int
    height: int
    levels: int
    layers: int
    aspect: int
    allocation: Allocation | None  # None: the memory belongs to another object
    name: str
    samples: int = 1
    array: bool = False
    depth: int | None = None  # slices of a 3D image
    views: list[Any] = field(default_factory=list)


def _buffer_info(size: int, usage: int, families: Sequence[int] = ()) -> Any:
    return vk.new(
        "VkBufferCreateInfo",
        size=max(int(size), 4),  # Vulkan has no empty buffers
        usage=usage,
        sharingMode=vk.VK_SHARING_MODE_CONCURRENT if families else vk.VK_SHARING_MODE_EXCLUSIVE,
        pQueueFamilyIndices=list(families) or None,
    )


def buffer_requirements(
    device: Device, size: int, usage: int, families: Sequence[int] = ()
) -> tuple[int, int, int]:
    """Return (bytes, alignment, mask of memory types) of a buffer that does not exist yet; see `create_buffer`."""
    info = vk.new("VkDeviceBufferMemoryRequirements", pCreateInfo=_buffer_info(size, usage, families))
    out = vk.new("VkMemoryRequirements2")
    device.fn.vkGetDeviceBufferMemoryRequirements(device.handle, info, out)
    requirements = out.memoryRequirements
    return int(requirements.size), int(requirements.alignment), int(requirements.memoryTypeBits)


def create_buffer(
    device: Device,
    size: int,
    usage: int,
    use: MemoryUse,
    name: str,
    place: tuple[Any, int] | None = None,
    families: Sequence[int] = (),
) -> Buffer:
    """Return a buffer of `size` bytes, 4 at least; with `place`, (VkDeviceMemory, offset), in the caller's memory.

    `families` are the queue families that use it, where they are several: else it belongs to one at a time.
    """
    info = _buffer_info(size, usage, families)
    handle = device.create("vkCreateBuffer", info, name)
    allocation = None
    try:
        if place is None:
            requirements = vk.new("VkMemoryRequirements")
            device.fn.vkGetBufferMemoryRequirements(device.handle, handle, requirements)
            allocation = device.memory.allocate(requirements, use, linear=True)
            place = allocation.memory, allocation.offset
        vk.check(device.fn.vkBindBufferMemory(device.handle, handle, *place), "vkBindBufferMemory", handle)
    except Exception as error:
        _undo(device, "VkBuffer", handle, allocation, error, f"'{name}'", int(info.size))
        raise
    return Buffer(handle, int(info.size), allocation, name)


def _undo(
    device: Device,
    kind: str,
    handle: Any,
    allocation: Allocation | None,
    error: Exception,
    what: str,
    size: int,
) -> None:
    """Free a resource that got no memory, and have the error say what it was."""
    device.destroy(kind, handle)
    if allocation is not None:
        device.memory.free(allocation)
    if isinstance(error, DeviceError):
        error.add_size(what, size)


def destroy_buffer(device: Device, buffer: Buffer) -> None:
    """Free a buffer that no submitted work uses."""
    device.destroy("VkBuffer", buffer.handle)
    if buffer.allocation is not None:
        device.memory.free(buffer.allocation)


def buffer_address(device: Device, buffer: Buffer) -> int:
    """Return the GPU's address of a buffer made with VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT."""
    info = vk.new("VkBufferDeviceAddressInfo", buffer=buffer.handle)
    return int(device.fn.vkGetBufferDeviceAddress(device.handle, info))


DEDICATED_SIZE = 16 << 20
"""Bytes from which an image gets memory of its own: render targets come and go with the window's size."""


def _image_info(
    format: str,
    size: tuple[int, int],
    usage: int,
    levels: int = 1,
    layers: int = 1,
    flags: int = 0,
    samples: int = 1,
    depth: int | None = None,
) -> Any:
    return vk.new(
        "VkImageCreateInfo",
        flags=flags,
        imageType=vk.VK_IMAGE_TYPE_2D if depth is None else vk.VK_IMAGE_TYPE_3D,
        format=FORMATS[format][0],
        extent={"width": size[0], "height": size[1], "depth": depth or 1},
        mipLevels=levels,
        arrayLayers=layers,
        samples=samples,  # the bit of a count is the count itself
        tiling=vk.VK_IMAGE_TILING_OPTIMAL,
        usage=usage,
        sharingMode=vk.VK_SHARING_MODE_EXCLUSIVE,
        initialLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED,
    )


def image_requirements(
    device: Device,
    format: str,
    size: tuple[int, int],
    usage: int,
    samples: int = 1,
    depth: int | None = None,
) -> tuple[int, int, int]:
    """Return (bytes, alignment, mask of memory types) of an image that does not exist yet."""
    info = vk.new(
        "VkDeviceImageMemoryRequirements",
        pCreateInfo=_image_info(format, size, usage, samples=samples, depth=depth),
    )
    out = vk.new("VkMemoryRequirements2")
    device.fn.vkGetDeviceImageMemoryRequirements(device.handle, info, out)
    requirements = out.memoryRequirements
    return int(requirements.size), int(requirements.alignment), int(requirements.memoryTypeBits)


def create_image(
    device: Device,
    format: str,
    size: tuple[int, int],
    usage: int,
    name: str,
    *,
    levels: int = 1,
    layers: int = 1,
    flags: int = 0,
    samples: int = 1,
    array: bool = False,
    depth: int | None = None,
    view_format: str | None = None,
    swizzle: str = "rgba",
    place: tuple[Any, int] | None = None,
) -> Image:
    """Return a 2D image of (width, height) and a view of all its levels; `view_format` is the view's, if another.

    It gets memory of its own, or with `place`, (VkDeviceMemory, offset), lies where the caller says: several images may
    lie in the same place, if only one of them is used at a time (see `image_requirements`).

    With several layers, or as an `array` of one, it is seen as an array texture; with a `depth` it is a 3D image of as
    many slices. `swizzle` says which channels of the
    image the view shows as red, green, blue and alpha: "0rg1" has the image's red in green.

    The view of an sRGB format is for sampling alone, so that the image itself can also be written by compute.

    Raises UnsupportedError for a compressed format that the device lacks: `blocks.storage_of` chooses another.
    """
    width, height = size
    allocation = None
    if blocks.is_compressed(format) and not device.has(blocks.FEATURE[format]):
        raise UnsupportedError(
            f"'{name}' cannot be stored as {format}: the device lacks {blocks.FEATURE[format]}."
        )
    aspect = vk.VK_IMAGE_ASPECT_DEPTH_BIT if format == "d32f" else vk.VK_IMAGE_ASPECT_COLOR_BIT
    if view_format is not None and view_format != format:
        flags |= vk.VK_IMAGE_CREATE_MUTABLE_FORMAT_BIT
    info = _image_info(format, size, usage, levels, layers, flags, samples, depth)
    handle = device.create("vkCreateImage", info, name)
    try:
        if place is None:
            allocation = _own_memory(device, handle)
            place = allocation.memory, allocation.offset
        vk.check(device.fn.vkBindImageMemory(device.handle, handle, *place), "vkBindImageMemory", handle)
    except Exception as error:
        what = f"'{name}' of {width}x{height} pixels"
        _undo(device, "VkImage", handle, allocation, error, what, int(_needs(device, handle).size))
        raise
    image = Image(
        handle,
        None,
        view_format or format,
        width,
        height,
        levels,
        layers,
        aspect,
        allocation,
        name,
        samples,
        array or layers > 1,
        depth,
    )
    sampled_only = view_format is not None and view_format != format
    try:
        image.view = create_view(
            device,
            image,
            image.format,
            usage=vk.VK_IMAGE_USAGE_SAMPLED_BIT if sampled_only else None,
            swizzle=swizzle,
        )
    except BaseException:
        destroy_image(device, image)
        raise
    return image


def _needs(device: Device, handle: Any) -> Any:
    requirements = vk.new("VkMemoryRequirements")
    device.fn.vkGetImageMemoryRequirements(device.handle, handle, requirements)
    return requirements


def _own_memory(device: Device, handle: Any) -> Allocation:
    requirements = _needs(device, handle)
    owner = None
    if requirements.size >= DEDICATED_SIZE:
        owner = vk.new("VkMemoryDedicatedAllocateInfo", image=handle)
    return device.memory.allocate(requirements, "device", linear=False, owner=owner)


_SWIZZLES = {
    "0": vk.VK_COMPONENT_SWIZZLE_ZERO,
    "1": vk.VK_COMPONENT_SWIZZLE_ONE,
    "r": vk.VK_COMPONENT_SWIZZLE_R,
    "g": vk.VK_COMPONENT_SWIZZLE_G,
    "b": vk.VK_COMPONENT_SWIZZLE_B,
    "a": vk.VK_COMPONENT_SWIZZLE_A,
}


def create_view(
    device: Device,
    image: Image,
    format: str,
    *,
    level: int = 0,
    levels: int | None = None,
    layer: int = 0,
    layers: int | None = None,
    usage: int | None = None,
    swizzle: str = "rgba",
) -> Any:
    """Return a view of some mip levels and layers from the given ones on (all by default), freed with its image."""
    info = _view_info(image, format, level, levels, layer, layers, usage, swizzle)
    view = device.create("vkCreateImageView", info, f"{image.name} view")
    image.views.append(view)
    return view


def create_level_views(
    device: Device, image: Image, format: str, *, layer: int, layers: int, usage: int
) -> list[Any]:
    """Return a view of each mip level alone, freed with its image."""
    info, name = _view_info(image, format, 0, 1, layer, layers, usage, "rgba"), f"{image.name} view"
    views, part = [], info.subresourceRange
    for level in range(image.levels):
        part.baseMipLevel = level  # filling a struct takes longer than making a view
        views.append(device.create("vkCreateImageView", info, name))
        image.views.append(views[-1])
    return views


def _view_info(
    image: Image,
    format: str,
    level: int,
    levels: int | None,
    layer: int,
    layers: int | None,
    usage: int | None,
    swizzle: str,
) -> Any:
    narrowed = vk.new("VkImageViewUsageCreateInfo", usage=usage) if usage is not None else None
    kind = vk.VK_IMAGE_VIEW_TYPE_2D_ARRAY if image.array else vk.VK_IMAGE_VIEW_TYPE_2D
    return vk.new(
        "VkImageViewCreateInfo",
        pNext=narrowed,
        image=image.handle,
        viewType=kind if image.depth is None else vk.VK_IMAGE_VIEW_TYPE_3D,
        format=FORMATS[format][0],
        components={
            channel: _SWIZZLES[shown]
            for channel, shown in zip("rgba", swizzle, strict=True)
            if shown != channel
        },
        subresourceRange={
            "aspectMask": image.aspect,
            "baseMipLevel": level,
            "levelCount": image.levels - level if levels is None else levels,
            "baseArrayLayer": layer,
            "layerCount": image.layers - layer if layers is None else layers,
        },
    )


def sample_counts(device: Device, format: str, usage: int) -> tuple[int, ...]:
    """Return how many samples a pixel of an image for `usage` can have, in ascending order; () where it can be none."""
    out = vk.new("VkImageFormatProperties")
    code = device.instance.fn.vkGetPhysicalDeviceImageFormatProperties(
        device.physical.handle,
        FORMATS[format][0],
        vk.VK_IMAGE_TYPE_2D,
        vk.VK_IMAGE_TILING_OPTIMAL,
        usage,
        0,
        out,
    )
    if code == vk.VK_ERROR_FORMAT_NOT_SUPPORTED:
        return ()
    vk.check(code, "vkGetPhysicalDeviceImageFormatProperties", device.physical.handle)
    return tuple(count for count in (1, 2, 4, 8, 16, 32, 64) if out.sampleCounts & count)


def destroy_image(device: Device, image: Image) -> None:
    """Free an image and its views, when no submitted work uses them."""
    for view in image.views:
        device.destroy("VkImageView", view)
    image.views.clear()
    device.destroy("VkImage", image.handle)
    if image.allocation is not None:
        device.memory.free(image.allocation)


_FILTERS = {"nearest": vk.VK_FILTER_NEAREST, "linear": vk.VK_FILTER_LINEAR}
_MIPMAPS = {"nearest": vk.VK_SAMPLER_MIPMAP_MODE_NEAREST, "linear": vk.VK_SAMPLER_MIPMAP_MODE_LINEAR}
_WRAPS = {
    "repeat": vk.VK_SAMPLER_ADDRESS_MODE_REPEAT,
    "clamp": vk.VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE,
    "mirror": vk.VK_SAMPLER_ADDRESS_MODE_MIRRORED_REPEAT,
}


def create_sampler(device: Device, sampler: Sampler, anisotropy: float, name: str) -> Any:
    """Return a VkSampler for glTF's filters and wraps; `anisotropy` above 1 needs the feature and trilinear filters.

    A sampler without mipmaps reads level 0 alone: its largest level is 0.25, since 0 would also choose the
    magnification filter for minified texels (Vulkan specification, "Image Sampling", note on VkSamplerCreateInfo).
    """
    trilinear = sampler.mag == sampler.min == sampler.mipmap == "linear"
    level = min(anisotropy, float(device.limits.maxSamplerAnisotropy)) if trilinear else 1.0
    info = vk.new(
        "VkSamplerCreateInfo",
        magFilter=_FILTERS[sampler.mag],
        minFilter=_FILTERS[sampler.min],
        mipmapMode=_MIPMAPS[sampler.mipmap or "nearest"],
        addressModeU=_WRAPS[sampler.wrap_u],
        addressModeV=_WRAPS[sampler.wrap_v],
        addressModeW=vk.VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE,
        anisotropyEnable=int(level > 1.0 and device.has("anisotropy")),
        maxAnisotropy=max(level, 1.0),
        maxLod=vk.VK_LOD_CLAMP_NONE if sampler.mipmap else 0.25,
    )
    return device.create("vkCreateSampler", info, name)


def mip_levels(width: int, height: int) -> int:
    """Return the number of levels of a full chain down to 1x1."""
    return max(width, height).bit_length()
