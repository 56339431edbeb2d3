"""Self-test: one shader invocation per pixel left of a line and one per 2x2 pixels right of it, as an image says."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.selftests.bench import FULL_SCREEN, Bench, differ

SIZE = 128

# Twice the centre of what one invocation covers, in pixels.
FRAGMENT = """
layout(location = 0) out uint color;
void main() { color = uint(gl_FragCoord.x * 2.0) | uint(gl_FragCoord.y * 2.0) << 16; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    fn, device = bench.fn, bench.device
    limits = vk.new("VkPhysicalDeviceFragmentShadingRatePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, outer)
    texel = limits.minFragmentShadingRateAttachmentTexelSize
    tile = (int(texel.width), int(texel.height))
    size = (-(-SIZE // tile[0]), -(-SIZE // tile[1]))
    line = size[0] // 2 * tile[0]  # in pixels
    rates = np.zeros((size[1], size[0]), np.uint8)
    rates[:, size[0] // 2 :] = 1 << 2 | 1  # logarithms of width and height
    image, view = _rate_image(bench, size)
    bench.fill(image, size, rates)
    layout = vk.VK_IMAGE_LAYOUT_FRAGMENT_SHADING_RATE_ATTACHMENT_OPTIMAL_KHR
    with bench.submit() as commands:
        bench.move(commands, image, vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL, layout)
    state = vk.new(
        "VkPipelineFragmentShadingRateStateCreateInfoKHR",
        fragmentSize={"width": 1, "height": 1},
        combinerOps=[
            vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_KEEP_KHR,
            vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_REPLACE_KHR,
        ],
    )
    attachment = vk.new(
        "VkRenderingFragmentShadingRateAttachmentInfoKHR",
        imageView=view,
        imageLayout=layout,
        shadingRateAttachmentTexelSize={"width": tile[0], "height": tile[1]},
    )
    program = bench.graphics({"vert": FULL_SCREEN, "frag": FRAGMENT}, rate=state)
    pixels = bench.render(
        program, (SIZE, SIZE), lambda commands: fn.vkCmdDraw(commands, 3, 1, 0, 0), rate=attachment
    )
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    coarse = (x // 2 * 4 + 2) | (y // 2 * 4 + 2) << 16
    fine = (2 * x + 1) | (2 * y + 1) << 16
    return differ("pixels", pixels, np.where(x < line, fine, coarse).astype(np.uint32))


def _rate_image(bench: Bench, size: tuple[int, int]) -> tuple[object, object]:
    """Return an image of one byte per tile and its view."""
    device, fn = bench.device, bench.fn
    usage = (
        vk.VK_IMAGE_USAGE_FRAGMENT_SHADING_RATE_ATTACHMENT_BIT_KHR
        | vk.VK_IMAGE_USAGE_SAMPLED_BIT
        | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    )
    image = bench.make(
        "vkCreateImage",
        "VkImageCreateInfo",
        imageType=vk.VK_IMAGE_TYPE_2D,
        format=vk.VK_FORMAT_R8_UINT,
        extent={"width": size[0], "height": size[1], "depth": 1},
        mipLevels=1,
        arrayLayers=1,
        samples=vk.VK_SAMPLE_COUNT_1_BIT,
        tiling=vk.VK_IMAGE_TILING_OPTIMAL,
        usage=usage,
    )
    requirements = vk.new("VkMemoryRequirements")
    fn.vkGetImageMemoryRequirements(device.handle, image, requirements)
    memory = device.memory.allocate(requirements, "device", linear=False)
    bench.at_end(device.memory.free, memory)
    vk.check(fn.vkBindImageMemory(device.handle, image, memory.memory, memory.offset), "vkBindImageMemory")
    view = bench.make(
        "vkCreateImageView",
        "VkImageViewCreateInfo",
        image=image,
        viewType=vk.VK_IMAGE_VIEW_TYPE_2D,
        format=vk.VK_FORMAT_R8_UINT,
        subresourceRange={"aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT, "levelCount": 1, "layerCount": 1},
    )
    return image, view
