"""Sparse images for the self-tests: created, and bound page by page to memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import FORMATS
from backends.vulkan.selftests.bench import Bench
from common.errors import UnsupportedError

SIZE = 256
"""Width and height in texels: two pages by two, where a page holds 128x128 texels of 4 bytes."""


@dataclass(frozen=True)
class SparseImage:
    """A sparse image of SIZE x SIZE texels with a view of all of it; `page` is (width, height) in texels."""

    handle: Any
    view: Any
    page: tuple[int, int]
    aspect: int


def sparse_image(
    bench: Bench,
    format: str,
    usage: int,
    *,
    layers: int = 1,
    flags: int = 0,
    view_type: int = vk.VK_IMAGE_VIEW_TYPE_2D,
    bound: Callable[[int, int], bool] = lambda column, row: True,
) -> SparseImage:
    """Return a sparse image whose pages have memory where `bound(column, row)`.

    Raises UnsupportedError where the queue cannot bind, or the format has no pages of this size.
    """
    fn, device = bench.fn, bench.device
    if not device.queue.flags & vk.VK_QUEUE_SPARSE_BINDING_BIT:
        raise UnsupportedError("The graphics queue cannot bind sparse memory.")
    depth = format == "d32f"
    aspect = vk.VK_IMAGE_ASPECT_DEPTH_BIT if depth else vk.VK_IMAGE_ASPECT_COLOR_BIT
    copies = vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    image = bench.make(
        "vkCreateImage",
        "VkImageCreateInfo",
        flags=flags | vk.VK_IMAGE_CREATE_SPARSE_BINDING_BIT | vk.VK_IMAGE_CREATE_SPARSE_RESIDENCY_BIT,
        imageType=vk.VK_IMAGE_TYPE_2D,
        format=FORMATS[format][0],
        extent={"width": SIZE, "height": SIZE, "depth": 1},
        mipLevels=1,
        arrayLayers=layers,
        samples=vk.VK_SAMPLE_COUNT_1_BIT,
        tiling=vk.VK_IMAGE_TILING_OPTIMAL,
        usage=usage | copies,
    )
    page, page_bytes = _page_of(bench, image)
    columns, rows = SIZE // page[0], SIZE // page[1]
    chosen = [
        (layer, column, row)
        for layer in range(layers)
        for row in range(rows)
        for column in range(columns)
        if bound(column, row)
    ]
    memory = _memory(bench, image, page_bytes * len(chosen))
    binds = [
        {
            "subresource": {"aspectMask": aspect, "arrayLayer": layer},
            "offset": {"x": column * page[0], "y": row * page[1]},
            "extent": {"width": page[0], "height": page[1], "depth": 1},
            "memory": memory,
            "memoryOffset": page_bytes * number,
        }
        for number, (layer, column, row) in enumerate(chosen)
    ]
    fence = bench.make("vkCreateFence", "VkFenceCreateInfo")
    info = vk.new("VkBindSparseInfo", pImageBinds=[{"image": image, "pBinds": binds}], imageBindCount=1)
    vk.check(fn.vkQueueBindSparse(device.queue.handle, 1, info, fence), "vkQueueBindSparse")
    fences = vk.array("VkFence", [fence])
    code = fn.vkWaitForFences(device.handle, 1, fences, 1, 10 * 10**9)
    vk.check(code, "vkWaitForFences")
    view = bench.make(
        "vkCreateImageView",
        "VkImageViewCreateInfo",
        image=image,
        viewType=view_type,
        format=FORMATS[format][0],
        subresourceRange={"aspectMask": aspect, "levelCount": 1, "layerCount": layers},
    )
    return SparseImage(image, view, page, aspect)


def _page_of(bench: Bench, image: Any) -> tuple[tuple[int, int], int]:
    """Return the size of a page in texels and in bytes."""
    fn, device = bench.fn, bench.device
    for requirement in vk.listed(
        fn.vkGetImageSparseMemoryRequirements,
        "vkGetImageSparseMemoryRequirements",
        "VkSparseImageMemoryRequirements",
        device.handle,
        image,
    ):
        size = requirement.formatProperties.imageGranularity
        # llvmpipe calls the aspect of a depth image colour: so anything but metadata will do.
        if requirement.formatProperties.aspectMask & vk.VK_IMAGE_ASPECT_METADATA_BIT:
            continue
        if requirement.imageMipTailFirstLod == 0 or SIZE % size.width or SIZE % size.height:
            raise UnsupportedError(f"Pages of {size.width}x{size.height} texels are not what is tried here.")
        requirements = vk.new("VkMemoryRequirements")
        fn.vkGetImageMemoryRequirements(device.handle, image, requirements)
        return (size.width, size.height), int(requirements.alignment)
    raise UnsupportedError("The image has no pages.")


def _memory(bench: Bench, image: Any, size: int) -> Any:
    """Return memory of its own for the pages: a share of a block need not be aligned to them."""
    requirements = vk.new("VkMemoryRequirements")
    bench.fn.vkGetImageMemoryRequirements(bench.device.handle, image, requirements)
    bits = int(requirements.memoryTypeBits)
    first = (bits & -bits).bit_length() - 1
    local = vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
    kinds = [i for i, t in enumerate(bench.device.memory.types) if bits >> i & 1 and t.flags & local]
    info = vk.new("VkMemoryAllocateInfo", allocationSize=size, memoryTypeIndex=(kinds or [first])[0])
    memory = bench.device.create("vkAllocateMemory", info, "selftest pages")
    bench.at_end(bench.device.destroy, "VkDeviceMemory", memory)
    return memory
