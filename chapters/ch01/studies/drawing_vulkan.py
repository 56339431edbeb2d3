"""What draws of a study are made of on Vulkan, each by one call: sets and pipelines, freed at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.shaders.compiler import compile_all

from ..frames.vulkan_commands import Commands
from ..pipelines.description import Binding
from .drawing import Drawn
from .first_triangle.vulkan import EVERY_CHANNEL
from .stage_vulkan import Stage

_CORNERS = {
    "triangles": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST,
    "lines": vk.VK_PRIMITIVE_TOPOLOGY_LINE_LIST,
}
_FLOATS = {
    2: vk.VK_FORMAT_R32G32_SFLOAT,
    3: vk.VK_FORMAT_R32G32B32_SFLOAT,
    4: vk.VK_FORMAT_R32G32B32A32_SFLOAT,
}
_DYNAMIC = [
    vk.VK_DYNAMIC_STATE_VIEWPORT,
    vk.VK_DYNAMIC_STATE_SCISSOR,
    vk.VK_DYNAMIC_STATE_CULL_MODE,
    vk.VK_DYNAMIC_STATE_FRONT_FACE,
]


@dataclass(frozen=True)
class Built:
    """A pipeline, and the layout through which descriptors reach it."""

    handle: Any
    layout: Any


class Drawing(Stage):
    """A stage for studies that draw with more than the chapter's own pipelines can."""

    folder: Path

    def sets(self, bindings: Sequence[Binding], held: Sequence[dict[int, Any]]) -> list[Any]:
        """Return descriptor sets, each ready to be bound: what `held` says of each number."""
        name = f"set of {self.study.title}"
        allocated = self.descriptors.create([(bindings, held_buffers, name) for held_buffers in held])
        return [vk.array("VkDescriptorSet", [handle]) for handle in allocated.handles]

    def build(self, bindings: Sequence[Binding], described: Drawn) -> Built:
        """Return a pipeline. The study first-triangle writes one out and says what each part is."""
        device, modules, stages = self.device, [], []
        defines = dict(described.defines)
        sources = [
            shader_text.build(self.folder / file, "vulkan", defines=defines) for file in described.shaders
        ]
        for source, code in zip(sources, compile_all(sources), strict=True):
            info = vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
            modules.append(device.create("vkCreateShaderModule", info, source.name))
            stage = (
                vk.VK_SHADER_STAGE_VERTEX_BIT if source.stage == "vert" else vk.VK_SHADER_STAGE_FRAGMENT_BIT
            )
            stages.append({"stage": stage, "module": modules[-1], "pName": "main"})
        info = vk.new("VkPipelineLayoutCreateInfo", pSetLayouts=[self.descriptors.layout(bindings)])
        layout = device.create("vkCreatePipelineLayout", info, self.study.title)
        self._made = [*getattr(self, "_made", ()), ("VkPipelineLayout", layout)]
        info = vk.new(
            "VkGraphicsPipelineCreateInfo",
            pNext=vk.new(
                "VkPipelineRenderingCreateInfo",
                pColorAttachmentFormats=[vk.VK_FORMAT_R8G8B8A8_UNORM],
                depthAttachmentFormat=vk.VK_FORMAT_D32_SFLOAT if self.has_depth else vk.VK_FORMAT_UNDEFINED,
            ),
            pStages=stages,
            pVertexInputState=_vertex_input(described),
            pInputAssemblyState={"topology": _CORNERS[described.corners]},
            pViewportState={"viewportCount": 1, "scissorCount": 1},
            pDynamicState={"pDynamicStates": _DYNAMIC},
            # Reversed z: what is farther away has the smaller depth, and so back is negative.
            pRasterizationState={
                "polygonMode": vk.VK_POLYGON_MODE_FILL if described.filled else vk.VK_POLYGON_MODE_LINE,
                "lineWidth": 1.0,
                "depthBiasEnable": int(described.push_back != 0.0),
                "depthBiasConstantFactor": -described.push_back,
                "depthBiasSlopeFactor": -described.push_back,
            },
            pMultisampleState={"rasterizationSamples": 1},
            pDepthStencilState={
                "depthTestEnable": int(described.depth),
                "depthWriteEnable": int(described.depth),
                "depthCompareOp": vk.VK_COMPARE_OP_GREATER_OR_EQUAL,
            },
            pColorBlendState={"pAttachments": [{"colorWriteMask": EVERY_CHANNEL}]},
            layout=layout,
        )
        infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
        handle = device.create_pipelines("vkCreateGraphicsPipelines", infos, [self.study.title])[0]
        self._made.append(("VkPipeline", handle))
        for module in modules:
            device.destroy("VkShaderModule", module)
        return Built(handle, layout)

    def bind(self, commands: Commands, pipeline: Built, descriptor_set: Any) -> None:
        """Draw with a pipeline from here on, both sides of each triangle, and let its shaders read a set."""
        fn, point = self.device.fn, vk.VK_PIPELINE_BIND_POINT_GRAPHICS
        fn.vkCmdBindPipeline(commands.handle, point, pipeline.handle)
        fn.vkCmdSetCullMode(commands.handle, vk.VK_CULL_MODE_NONE)
        fn.vkCmdSetFrontFace(commands.handle, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        fn.vkCmdBindDescriptorSets(commands.handle, point, pipeline.layout, 0, 1, descriptor_set, 0, vk.NULL)

    def destroy(self) -> None:
        """Free pipelines; buffers and sets belong to the stage."""
        for kind, handle in getattr(self, "_made", ()):
            self.device.destroy(kind, handle)


def _vertex_input(described: Drawn) -> dict[str, Any]:
    if not described.attributes:
        return {}
    return {
        "pVertexBindingDescriptions": [{"binding": 0, "stride": described.stride}],
        "pVertexAttributeDescriptions": [
            {
                "location": attribute.location,
                "binding": 0,
                "format": _FLOATS[attribute.floats],
                "offset": attribute.offset,
            }
            for attribute in described.attributes
        ],
    }
