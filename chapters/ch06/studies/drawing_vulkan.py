"""Graphics pipelines of studies with what the chapter's own do not have: patches for tessellation, and vertex buffers.

The chapter's pipelines draw triangles whose vertices come from storage buffers. A study that needs more describes it by
`Drawn`, and `Drawing.build` creates the pipeline from the same reflection and the same layouts.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import FORMATS
from backends.vulkan.shaders.live import compile_stages

from ..pipelines.description import Built, PipelineDescription
from ..pipelines.vulkan import source_of
from ..pipelines.vulkan_reflection import STAGES, Stage, merge
from .stage_vulkan import Stage as StudyStage

_FLOATS = {
    2: vk.VK_FORMAT_R32G32_SFLOAT,
    3: vk.VK_FORMAT_R32G32B32_SFLOAT,
    4: vk.VK_FORMAT_R32G32B32A32_SFLOAT,
}
_DYNAMIC = (
    vk.VK_DYNAMIC_STATE_VIEWPORT,
    vk.VK_DYNAMIC_STATE_SCISSOR,
    vk.VK_DYNAMIC_STATE_CULL_MODE,
    vk.VK_DYNAMIC_STATE_FRONT_FACE,
)
_EVERY_CHANNEL = 0b1111


@dataclass(frozen=True)
class Drawn(PipelineDescription):
    """The description of a pipeline, with the vertices of a patch (0 for triangles) and the streams of vertices.

    `streams` are the floats of each attribute. Attribute i has location i and comes, tightly packed, from binding i.
    """

    patch: int = 0
    streams: tuple[int, ...] = ()


class Drawing(StudyStage):
    """A study that builds pipelines of its own."""

    _builds = False

    def build(self, drawn: Drawn) -> Built:
        """Return a pipeline that lives as long as the study."""
        device = self.device
        self._builds = True
        compiled = compile_stages([[source_of(file, drawn.defines) for file in drawn.shaders]])[0]
        stages = [Stage(code, source) for code, source in zip(compiled.codes, compiled.sources, strict=True)]
        signature = merge(stages)
        layout, sets = self.pipelines.layouts.pipeline(signature)
        modules = []
        try:
            for file, code in zip(drawn.shaders, compiled.codes, strict=True):
                info = vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
                modules.append(device.create("vkCreateShaderModule", info, file))
            info = _create_info(drawn, [stage.name for stage in stages], modules, layout)
            infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
            handle = device.create_pipelines("vkCreateGraphicsPipelines", infos, [drawn.title])[0]
        finally:
            for module in modules:
                device.destroy("VkShaderModule", module)
        self.keep(handle, lambda pipeline: device.destroy("VkPipeline", pipeline))
        push = self.pipelines.layouts.stages(signature.stages) if signature.push else 0
        return Built(drawn, handle, compiled, layout, sets, push)

    @property
    def shader_files(self) -> frozenset[Path]:
        """No files once the study has built a pipeline by itself: after an edit it is opened anew."""
        return frozenset() if self._builds else super().shader_files


def _create_info(drawn: Drawn, names: list[str], modules: list[Any], layout: Any) -> Any:
    """Return the VkGraphicsPipelineCreateInfo of a description. The state is that of the chapter's pipelines."""
    # The first vertex of OpenGL's patch domain is at the lower left, that of Vulkan's at the upper left. With Vulkan's
    # default, triangles of the domain would have the opposite winding.
    domain = vk.new(
        "VkPipelineTessellationDomainOriginStateCreateInfo",
        domainOrigin=vk.VK_TESSELLATION_DOMAIN_ORIGIN_LOWER_LEFT,
    )
    patches = vk.new(
        "VkPipelineTessellationStateCreateInfo", pNext=domain, patchControlPoints=max(drawn.patch, 1)
    )
    topology = vk.VK_PRIMITIVE_TOPOLOGY_PATCH_LIST if drawn.patch else vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST
    attachment: dict[str, Any] = {"colorWriteMask": _EVERY_CHANNEL}
    compare = vk.VK_COMPARE_OP_EQUAL if drawn.depth == "equal" else vk.VK_COMPARE_OP_GREATER_OR_EQUAL
    rendering = vk.new(
        "VkPipelineRenderingCreateInfo",
        pColorAttachmentFormats=[FORMATS[name][0] for name in drawn.colors],
        depthAttachmentFormat=FORMATS["d32f"][0] if drawn.depth else vk.VK_FORMAT_UNDEFINED,
    )
    return vk.new(
        "VkGraphicsPipelineCreateInfo",
        pNext=rendering,
        pStages=[
            {"stage": STAGES[name], "module": module, "pName": "main"}
            for name, module in zip(names, modules, strict=True)
        ],
        pVertexInputState=_vertex_input(drawn.streams),
        pInputAssemblyState={"topology": topology},
        pTessellationState=patches if drawn.patch else None,
        pViewportState={"viewportCount": 1, "scissorCount": 1},
        pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
        pMultisampleState={"rasterizationSamples": 1},
        pDepthStencilState={
            "depthTestEnable": int(drawn.depth is not None),
            "depthWriteEnable": int(drawn.depth == "write"),
            "depthCompareOp": compare,
        },
        pColorBlendState={"pAttachments": [attachment] * len(drawn.colors)},
        pDynamicState={"pDynamicStates": list(_DYNAMIC)},
        layout=layout,
    )


def _vertex_input(streams: tuple[int, ...]) -> dict[str, Any]:
    if not streams:
        return {}
    return {
        "pVertexBindingDescriptions": [
            {"binding": number, "stride": 4 * floats} for number, floats in enumerate(streams)
        ],
        "pVertexAttributeDescriptions": [
            {"location": number, "binding": number, "format": _FLOATS[floats]}
            for number, floats in enumerate(streams)
        ],
    }
