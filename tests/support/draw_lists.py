"""Draws a list of a user interface on either backend without a window, and a model of it in numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backends.gl import readback as gl_readback
from backends.gl import resources as gl_resources
from backends.gl.context import Context
from backends.gl.targets import create_framebuffer, destroy_framebuffer
from backends.gl.window import draw_lists as gl_lists
from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import FORMATS, create_image, destroy_image
from backends.vulkan.upload import Uploader
from backends.vulkan.window import draw_lists as vulkan_lists
from common.view.draw_lists import VERTEX, DrawList


def on_vulkan(device: Device, lists: Sequence[DrawList], background: np.ndarray) -> list[np.ndarray]:
    """Return the (H, W, 4) uint8 pictures of lists, each drawn over `background`, one after the other."""
    height, width = background.shape[:2]
    usage = (
        vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT
        | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        | vk.VK_IMAGE_USAGE_SAMPLED_BIT
    )
    target = create_image(device, "rgba8", (width, height), usage, "drawn")
    renderer = vulkan_lists.DrawLists(device, FORMATS["rgba8"][0], 2)
    found = []
    try:
        for number, drawn in enumerate(lists):
            with Uploader(device) as uploader:
                uploader.image(target, background)
            renderer.update(drawn)
            with submit_once(device) as commands:
                transition(device, commands, target, "sampled", "color")
                renderer.record(commands, number % 2, drawn, target.view, (width, height))
            found.append(read_image(device, target, "color"))
    finally:
        device.wait_idle()
        renderer.close()
        destroy_image(device, target)
    return found


def on_gl(context: Context, lists: Sequence[DrawList], background: np.ndarray) -> list[np.ndarray]:
    """Return what `on_vulkan` returns, drawn by OpenGL over a copy of the background."""
    height, width = background.shape[:2]
    picture = gl_resources.create_image(context, "rgba8", (width, height), "picture")
    gl_resources.write_image(context, picture, background)
    framebuffer = create_framebuffer(context, [picture], None, "picture")
    renderer = gl_lists.DrawLists(context)
    found = []
    try:
        for drawn in lists:
            renderer.update(drawn)
            over = renderer.over(framebuffer, drawn, (width, height))
            found.append(gl_readback.read_image(context, over.colors[0].image))
        assert np.array_equal(gl_readback.read_image(context, picture), background), "the picture was kept"
    finally:
        renderer.close()
        destroy_framebuffer(context, framebuffer)
        gl_resources.destroy_image(context, picture)
    return found


def quad(
    box: tuple[float, float, float, float],
    uv: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
    color: tuple[int, int, int, int] = (255, 255, 255, 255),
) -> np.ndarray:
    """Return the four vertices (4,) VERTEX of a rectangle (left, top, right, bottom)."""
    corners = [(0, 1), (2, 1), (2, 3), (0, 3)]
    vertices = np.zeros(4, VERTEX)
    vertices["position"] = [(box[x], box[y]) for x, y in corners]
    vertices["uv"] = [(uv[x], uv[y]) for x, y in corners]
    vertices["color"] = color
    return vertices


QUAD = np.array([0, 1, 2, 0, 2, 3], np.uint32)
"""The indices of a quad's two triangles."""


def blended(target: np.ndarray, box: tuple[int, int, int, int], source: tuple[int, int, int, int]) -> None:
    """Lay one display code over a box of (H, W, 4) float64 codes, as a list's documentation says."""
    left, top, right, bottom = box
    part = target[top:bottom, left:right]
    color, alpha = np.asarray(source[:3], np.float64), source[3] / 255
    part[..., :3] = color * alpha + part[..., :3] * (1 - alpha)
    part[..., 3] = source[3] + part[..., 3] * (1 - alpha)
