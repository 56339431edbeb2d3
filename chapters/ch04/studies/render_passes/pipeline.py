"""A pipeline for a pass of either kind: all but one member of its description is the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.shaders.live import compile_stages

from ...pipelines.description import Built, PipelineDescription
from ...pipelines.vulkan import CHAPTER
from ...pipelines.vulkan_layouts import Layouts
from ...pipelines.vulkan_reflection import STAGES, Stage, merge

_EVERY_CHANNEL = 0xF


def create_pipeline(
    device: Device, layouts: Layouts, files: Sequence[str], into: dict[str, Any], depth: bool
) -> Built:
    """Return a pipeline; the caller destroys its handle. `into` is the render pass or the formats that it draws to."""
    sources = [shader_text.build(CHAPTER / file, "vulkan", roots=(CHAPTER,)) for file in files]
    stages = compile_stages([sources])[0]
    codes = stages.codes
    merged = [Stage(code, source) for code, source in zip(codes, sources, strict=True)]
    layout, sets = layouts.pipeline(merge(merged, ()))
    modules = [
        device.create(
            "vkCreateShaderModule",
            vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code),
            source.name,
        )
        for code, source in zip(codes, sources, strict=True)
    ]
    dynamic = [
        vk.VK_DYNAMIC_STATE_VIEWPORT,
        vk.VK_DYNAMIC_STATE_SCISSOR,
        vk.VK_DYNAMIC_STATE_CULL_MODE,
        vk.VK_DYNAMIC_STATE_FRONT_FACE,
    ]
    info = vk.new(
        "VkGraphicsPipelineCreateInfo",
        pStages=[
            {"stage": STAGES[source.stage], "module": module, "pName": "main"}
            for source, module in zip(sources, modules, strict=True)
        ],
        pVertexInputState={},
        pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
        pViewportState={"viewportCount": 1, "scissorCount": 1},
        pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
        pMultisampleState={"rasterizationSamples": 1},
        pDepthStencilState={
            "depthTestEnable": int(depth),
            "depthWriteEnable": int(depth),
            "depthCompareOp": vk.VK_COMPARE_OP_GREATER_OR_EQUAL,  # reversed z: nearer is greater
        },
        pColorBlendState={"pAttachments": [{"colorWriteMask": _EVERY_CHANNEL}]},
        pDynamicState={"pDynamicStates": dynamic},
        layout=layout,
        **into,
    )
    infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
    pipeline = device.create_pipelines("vkCreateGraphicsPipelines", infos, [sources[-1].name])[0]
    for module in modules:
        device.destroy("VkShaderModule", module)
    return Built(PipelineDescription(tuple(files)), pipeline, stages, layout, sets)
