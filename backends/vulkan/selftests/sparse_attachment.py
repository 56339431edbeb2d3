"""Self-test: what is drawn into a sparse colour attachment of several pages is what a copy reads from it."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.selftests.bench import EVERYTHING, FULL_SCREEN, Bench, Program, differ
from backends.vulkan.selftests.pages import SIZE, sparse_image

FRAGMENT = """
layout(location = 0) out uint color;
void main() { color = uint(gl_FragCoord.y) * 1000u + uint(gl_FragCoord.x) + 1u; }
"""


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics({"vert": FULL_SCREEN, "frag": FRAGMENT})
    pixels = drawn(bench, program, "r32ui").view(np.uint32)
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    return differ("pixels", pixels, (y * 1000 + x + 1).astype(np.uint32))


def drawn(bench: Bench, program: Program, format: str) -> np.ndarray:
    """Return (SIZE, SIZE) words: what a full-screen triangle leaves in a sparse attachment of `format`."""
    depth = format == "d32f"
    usage = (
        vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT if depth else vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT
    )
    layout = (
        vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL if depth else vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL
    )
    image = sparse_image(bench, format, usage)
    output = bench.output(SIZE * SIZE)
    region = vk.new(
        "VkBufferImageCopy",
        imageSubresource={"aspectMask": image.aspect, "layerCount": 1},
        imageExtent={"width": SIZE, "height": SIZE, "depth": 1},
    )
    source = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
    fn, size = bench.fn, (SIZE, SIZE)
    with bench.submit() as commands:
        bench.move(commands, image.handle, vk.VK_IMAGE_LAYOUT_UNDEFINED, layout, image.aspect)
        bench.draw(commands, program, image.view, size, lambda c: fn.vkCmdDraw(c, 3, 1, 0, 0), depth=depth)
        bench.move(commands, image.handle, layout, source, image.aspect)
        fn.vkCmdCopyImageToBuffer(commands, image.handle, source, output.handle, 1, region)
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return bench.read(output, np.uint32).reshape(SIZE, SIZE)
