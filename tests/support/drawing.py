"""Draws triangles through `backends.vulkan` alone, without a chapter: one pipeline, one target, one call."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import (
    FORMATS,
    Image,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.shaders.compiler import compile_shader

FULLSCREEN = """
void main() {
    vec2 corner = vec2(VERTEX_ID & 1, VERTEX_ID >> 1);
    gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}
"""
"""A vertex shader whose three vertices cover the whole target."""

PASS_ON = """
layout(location = 0) in vec4 in_position;
void main() {
    gl_Position = in_position;
}
"""
"""A vertex shader that takes clip positions as they are."""

_VECTORS = {1: vk.VK_FORMAT_R32_SFLOAT, 2: vk.VK_FORMAT_R32G32_SFLOAT, 4: vk.VK_FORMAT_R32G32B32A32_SFLOAT}


def draw(
    device: Device,
    fragment: str,
    size: tuple[int, int],
    *,
    vertex: str = FULLSCREEN,
    vertices: np.ndarray | None = None,
    format: str = "rgba32f",
    add: bool = False,
    textures: Mapping[int, tuple[Image, Any]] | None = None,
    clear: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
) -> np.ndarray:
    """Return (H, W) or (H, W, C) of a target of `format`, drawn once.

    `vertices` is (N, 1, 2 or 4) float32 at location 0, three to a triangle; without it three vertices are drawn.
    `textures` maps bindings of set 0 to (image, VkSampler); `add` sums the fragments up.
    """
    with ExitStack() as stack:

        def create(call: str, info: Any) -> Any:
            handle = device.create(call, info, "drawing")
            stack.callback(device.destroy, "Vk" + call.removeprefix("vkCreate"), handle)
            return handle

        fn, width, height = device.fn, *size
        usage = vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        target = create_image(device, format, size, usage, "drawing")
        stack.callback(destroy_image, device, target)
        stages = []
        for kind, text in (("vert", vertex), ("frag", fragment)):
            code = compile_shader(shader_text.build_text(text, kind, "vulkan", name=f"<{kind}>"))
            module = create(
                "vkCreateShaderModule", vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
            )
            bit = vk.VK_SHADER_STAGE_VERTEX_BIT if kind == "vert" else vk.VK_SHADER_STAGE_FRAGMENT_BIT
            stages.append(vk.new("VkPipelineShaderStageCreateInfo", stage=bit, module=module, pName="main"))
        set_layouts, sets = _texture_set(device, create, textures or {})
        layout = create(
            "vkCreatePipelineLayout", vk.new("VkPipelineLayoutCreateInfo", pSetLayouts=set_layouts)
        )
        pipeline = _pipeline(device, stages, layout, format, size, vertices, add)
        stack.callback(device.destroy, "VkPipeline", pipeline)
        buffer = None
        if vertices is not None:
            data = np.ascontiguousarray(vertices, np.float32)
            usage = vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT
            buffer = create_buffer(device, data.nbytes, usage, "upload", "drawing")
            stack.callback(destroy_buffer, device, buffer)
            buffer.mapped[: data.nbytes] = data.view(np.uint8).reshape(-1)
        rendering = vk.new(
            "VkRenderingInfo",
            renderArea={"extent": {"width": width, "height": height}},
            layerCount=1,
            pColorAttachments=[
                {
                    "imageView": target.view,
                    "imageLayout": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                    "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
                    "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
                    "clearValue": {"color": {"float32": list(clear)}},
                }
            ],
        )
        with submit_once(device) as commands:
            transition(device, commands, target, "undefined", "color")
            fn.vkCmdBeginRendering(commands, rendering)
            fn.vkCmdBindPipeline(commands, vk.VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline)
            if sets is not None:
                point = vk.VK_PIPELINE_BIND_POINT_GRAPHICS
                fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets, 0, vk.NULL)
            if buffer is not None:
                offsets = vk.array("VkDeviceSize", [0])
                fn.vkCmdBindVertexBuffers(commands, 0, 1, vk.array("VkBuffer", [buffer.handle]), offsets)
            fn.vkCmdDraw(commands, 3 if vertices is None else len(vertices), 1, 0, 0)
            fn.vkCmdEndRendering(commands)
        return read_image(device, target, "color")


def _texture_set(
    device: Device, create: Any, textures: Mapping[int, tuple[Image, Any]]
) -> tuple[list[Any], Any]:
    if not textures:
        return [], None
    kind = vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER
    bindings = [
        {
            "binding": number,
            "descriptorType": kind,
            "descriptorCount": 1,
            "stageFlags": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
        }
        for number in textures
    ]
    layout = create(
        "vkCreateDescriptorSetLayout", vk.new("VkDescriptorSetLayoutCreateInfo", pBindings=bindings)
    )
    sizes = [{"type": kind, "descriptorCount": len(textures)}]
    pool = create("vkCreateDescriptorPool", vk.new("VkDescriptorPoolCreateInfo", maxSets=1, pPoolSizes=sizes))
    sets = vk.ffi.new("VkDescriptorSet[1]")
    allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=[layout])
    vk.check(device.fn.vkAllocateDescriptorSets(device.handle, allocate, sets), "vkAllocateDescriptorSets")
    writes = [
        {
            "dstSet": sets[0],
            "dstBinding": number,
            "descriptorCount": 1,
            "descriptorType": kind,
            "pImageInfo": [
                {
                    "sampler": sampler,
                    "imageView": image.view,
                    "imageLayout": vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL,
                }
            ],
        }
        for number, (image, sampler) in textures.items()
    ]
    made = vk.array("VkWriteDescriptorSet", writes)
    device.fn.vkUpdateDescriptorSets(device.handle, len(writes), made, 0, vk.NULL)
    return [layout], sets


def _pipeline(
    device: Device,
    stages: list[Any],
    layout: Any,
    format: str,
    size: tuple[int, int],
    vertices: np.ndarray | None,
    add: bool,
) -> Any:
    channels = vertices.shape[1] if vertices is not None else 0
    one = vk.VK_BLEND_FACTOR_ONE
    blend = {"srcColorBlendFactor": one, "dstColorBlendFactor": one, "srcAlphaBlendFactor": one}
    blend |= {"dstAlphaBlendFactor": one, "blendEnable": int(add), "colorWriteMask": 15}
    extent = {"width": size[0], "height": size[1]}
    info = vk.new(
        "VkGraphicsPipelineCreateInfo",
        pNext=vk.new("VkPipelineRenderingCreateInfo", pColorAttachmentFormats=[FORMATS[format][0]]),
        pStages=stages,
        pVertexInputState={
            "pVertexBindingDescriptions": [{"stride": 4 * channels}],
            "pVertexAttributeDescriptions": [{"format": _VECTORS[channels]}],
        }
        if channels
        else {},
        pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
        pViewportState={
            "pViewports": [{"width": float(size[0]), "height": float(size[1]), "maxDepth": 1.0}],
            "pScissors": [{"extent": extent}],
        },
        pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
        pMultisampleState={"rasterizationSamples": vk.VK_SAMPLE_COUNT_1_BIT},
        pColorBlendState={"pAttachments": [blend]},
        pDynamicState={},
        layout=layout,
    )
    infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
    return device.create_pipelines("vkCreateGraphicsPipelines", infos, ["drawing"])[0]
