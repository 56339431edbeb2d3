"""How a VkRenderPass is made from flags: attachments, one subpass, and what is waited for before it and after it."""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import STATES
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS

from .flags import Flag, Use, uses

LOADS = {
    "load": vk.VK_ATTACHMENT_LOAD_OP_LOAD,
    "clear": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
    "dont_care": vk.VK_ATTACHMENT_LOAD_OP_DONT_CARE,
}
STORES = {"store": vk.VK_ATTACHMENT_STORE_OP_STORE, "dont_care": vk.VK_ATTACHMENT_STORE_OP_DONT_CARE}
# Render passes know a layout of depth alone only with a feature (separateDepthStencilLayouts) that is not asked for.
LAYOUTS = {name: state.layout for name, state in STATES.items()}
LAYOUTS["depth"] = vk.VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL

_COLOR, _DEPTH = (
    vk.VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT,
    vk.VK_PIPELINE_STAGE_EARLY_FRAGMENT_TESTS_BIT | vk.VK_PIPELINE_STAGE_LATE_FRAGMENT_TESTS_BIT,
)
_COLOR_WRITE, _DEPTH_WRITE = (
    vk.VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT,
    vk.VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
)
_COLOR_ANY = _COLOR_WRITE | vk.VK_ACCESS_COLOR_ATTACHMENT_READ_BIT
_DEPTH_ANY = _DEPTH_WRITE | vk.VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_READ_BIT
_READERS = {
    "sampled": (vk.VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT, vk.VK_ACCESS_SHADER_READ_BIT),
    "copy_source": (vk.VK_PIPELINE_STAGE_TRANSFER_BIT, vk.VK_ACCESS_TRANSFER_READ_BIT),
    "color": (_COLOR, _COLOR_ANY),
}
"""Stages and accesses of the next use of a target, by its final state."""


def create_render_pass(device: Device, formats: tuple[str, str | None], flags: Flag, name: str) -> Any:
    """Return a VkRenderPass of one subpass for a colour and perhaps a depth of these formats; ValueError as `uses`."""
    described = list(zip(formats, uses(flags), strict=True))
    attachments = [_attachment(form, use) for form, use in described if form is not None]
    references = [
        {"attachment": number, "layout": LAYOUTS[state]} for number, state in enumerate(("color", "depth"))
    ]
    subpass = {
        "pipelineBindPoint": vk.VK_PIPELINE_BIND_POINT_GRAPHICS,
        "pColorAttachments": references[:1],
        "pDepthStencilAttachment": references[1] if formats[1] else None,
    }
    info = vk.new(
        "VkRenderPassCreateInfo2",
        pAttachments=attachments,
        pSubpasses=[subpass],
        pDependencies=_dependencies(uses(flags)[0], formats[1] is not None),
    )
    out = vk.ffi.new("VkRenderPass *")
    vk.check(device.fn.vkCreateRenderPass2(device.handle, info, vk.NULL, out), "vkCreateRenderPass2", info)
    device.adopt("VkRenderPass", out[0], name)
    return out[0]


def _attachment(format: str, use: Use) -> dict[str, Any]:
    return {
        "format": FORMATS[format][0],
        "samples": 1,
        "loadOp": LOADS[use.load],
        "storeOp": STORES[use.store],
        "stencilLoadOp": vk.VK_ATTACHMENT_LOAD_OP_DONT_CARE,
        "stencilStoreOp": vk.VK_ATTACHMENT_STORE_OP_DONT_CARE,
        "initialLayout": LAYOUTS[use.initial],
        "finalLayout": LAYOUTS[use.final],
    }


def _dependencies(color: Use, has_depth: bool) -> list[dict[str, Any]]:
    """Return what the pass waits for, and what waits for it, in place of barriers before and after.

    A pass does not know the last use of its target, so it waits for all possible ones: shaders and copies that read it,
    and passes that drew to it. The dependency is not by region, since a shader may sample a target anywhere.
    """
    stages, writes, any_use = (
        (_COLOR | _DEPTH, _COLOR_WRITE | _DEPTH_WRITE, _COLOR_ANY | _DEPTH_ANY)
        if has_depth
        else (_COLOR, _COLOR_WRITE, _COLOR_ANY)
    )
    reader_stages, reader_access = _READERS[color.final]
    before = {
        "srcSubpass": vk.VK_SUBPASS_EXTERNAL,
        "dstSubpass": 0,
        "srcStageMask": stages | _READERS["sampled"][0] | _READERS["copy_source"][0],
        "srcAccessMask": writes,
        "dstStageMask": stages,
        "dstAccessMask": any_use,
    }
    after = {
        "srcSubpass": 0,
        "dstSubpass": vk.VK_SUBPASS_EXTERNAL,
        "srcStageMask": stages,
        "srcAccessMask": writes,
        "dstStageMask": reader_stages | (_DEPTH if has_depth else 0),
        "dstAccessMask": reader_access | (_DEPTH_ANY if has_depth else 0),
    }
    return [before, after]
