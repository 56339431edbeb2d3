"""Graphics pipelines: the objects that the driver builds from descriptions.

Equal descriptions share one pipeline. Viewport, scissor, culling and the front face are dynamic state, since they
change with the window and with mirrored objects; everything else is fixed when the pipeline is built.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS
from backends.vulkan.shaders.live import Stages, check_fit, compile_stages
from common.layouts import SNIPPETS

from ..scene.packing import PUSH_SIZE
from .description import Binding, Built, PipelineDescription
from .vulkan_descriptors import Descriptors

CHAPTER = Path(__file__).resolve().parents[1]

_STAGES = {
    ".vert": vk.VK_SHADER_STAGE_VERTEX_BIT,
    ".frag": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
}

_VERTEX_FORMATS = {
    2: vk.VK_FORMAT_R32G32_SFLOAT,
    3: vk.VK_FORMAT_R32G32B32_SFLOAT,
    4: vk.VK_FORMAT_R32G32B32A32_SFLOAT,
}

_ALL_CHANNELS = (
    vk.VK_COLOR_COMPONENT_R_BIT
    | vk.VK_COLOR_COMPONENT_G_BIT
    | vk.VK_COLOR_COMPONENT_B_BIT
    | vk.VK_COLOR_COMPONENT_A_BIT
)


class Pipelines:
    """Builds pipelines at their first use and keeps them."""

    def __init__(self, device: Device, descriptors: Descriptors) -> None:
        self._device, self._descriptors = device, descriptors
        self._built: dict[PipelineDescription, Built] = {}
        self._layouts: dict[tuple[tuple[Binding, ...], ...], Any] = {}

    def __len__(self) -> int:
        return len(self._built)

    def get(self, descriptions: Sequence[PipelineDescription]) -> list[Built]:
        """Return one pipeline per description; the shaders of new pipelines are compiled together, on threads."""
        new = [described for described in dict.fromkeys(descriptions) if described not in self._built]
        for described, stages in zip(new, self._compile(new), strict=True):
            handle = self._build(described, stages.codes)
            self._built[described] = Built(described, handle, stages, self._layout(described.sets))
        return [self._built[described] for described in descriptions]

    def _compile(self, descriptions: Sequence[PipelineDescription], keep: bool = True) -> list[Stages]:
        sources = [
            [
                shader_text.build(
                    CHAPTER / file,
                    "vulkan",
                    roots=(CHAPTER,),
                    defines=dict(described.defines),
                    snippets=SNIPPETS,
                )
                for file in described.shaders
            ]
            for described in descriptions
        ]
        return compile_stages(sources, keep)

    @property
    def files(self) -> frozenset[Path]:
        """All files that the shaders of these pipelines depend on."""
        return frozenset().union(*(built.code.files for built in self._built.values()))

    def reload(
        self, changed: Collection[Path], retire: Callable[[Callable[[], None]], None]
    ) -> tuple[str, ...]:
        """Rebuild the pipelines whose code a file of `changed` changes, and return their names; all, or none.

        `retire` gets a function that destroys an old pipeline, to be called when no frame in flight uses it. Raises
        ShaderError for a shader that does not compile, or that no longer fits its bindings.
        """
        old = {described: built for described, built in self._built.items() if built.code.use(changed)}
        new = dict(zip(old, self._compile(list(old), keep=False), strict=True))
        for described, stages in new.items():
            check_fit(old[described].code, stages, changed)
        anew = [described for described in old if new[described].codes != old[described].code.codes]
        handles: dict[PipelineDescription, Any] = {}
        try:
            for described in anew:
                handles[described] = self._build(described, new[described].codes)
        except BaseException:
            for handle in handles.values():
                self._device.destroy("VkPipeline", handle)
            raise
        for described in anew:
            retire(partial(self._device.destroy, "VkPipeline", old[described].handle))
            old[described].handle = handles[described]
        for described, built in old.items():
            built.code = new[described]
        return tuple(described.title for described in anew)

    def _layout(self, sets: tuple[tuple[Binding, ...], ...]) -> Any:
        if sets not in self._layouts:
            stages = vk.VK_SHADER_STAGE_VERTEX_BIT | vk.VK_SHADER_STAGE_FRAGMENT_BIT
            info = vk.new(
                "VkPipelineLayoutCreateInfo",
                pSetLayouts=[self._descriptors.layout(bindings) for bindings in sets],
                pPushConstantRanges=[{"stageFlags": stages, "size": PUSH_SIZE}],
            )
            self._layouts[sets] = self._device.create("vkCreatePipelineLayout", info, "graphics")
        return self._layouts[sets]

    def _build(self, described: PipelineDescription, codes: Sequence[bytes]) -> Any:
        modules = [
            self._device.create(
                "vkCreateShaderModule",
                vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code),
                file,
            )
            for file, code in zip(described.shaders, codes, strict=True)
        ]
        stages = [
            vk.new(
                "VkPipelineShaderStageCreateInfo",
                stage=_STAGES[Path(file).suffix],
                module=module,
                pName="main",
            )
            for file, module in zip(described.shaders, modules, strict=True)
        ]
        layout = self._layout(described.sets)
        dynamic = [
            vk.VK_DYNAMIC_STATE_VIEWPORT,
            vk.VK_DYNAMIC_STATE_SCISSOR,
            vk.VK_DYNAMIC_STATE_CULL_MODE,
            vk.VK_DYNAMIC_STATE_FRONT_FACE,
        ]
        rendering = vk.new(
            "VkPipelineRenderingCreateInfo",
            pColorAttachmentFormats=[FORMATS[described.color][0]] if described.color else None,
            depthAttachmentFormat=FORMATS["d32f"][0] if described.depth else vk.VK_FORMAT_UNDEFINED,
        )
        info = vk.new(
            "VkGraphicsPipelineCreateInfo",
            pNext=rendering,
            pStages=stages,
            pVertexInputState=self._vertex_input(described),
            pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
            pViewportState={"viewportCount": 1, "scissorCount": 1},
            pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
            pMultisampleState={"rasterizationSamples": described.samples},
            pDepthStencilState=self._depth(described),
            pColorBlendState=self._blend(described),
            pDynamicState={"pDynamicStates": dynamic},
            layout=layout,
        )
        infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
        try:
            return self._device.create_pipelines("vkCreateGraphicsPipelines", infos, [described.title])[0]
        finally:
            for module in modules:
                self._device.destroy("VkShaderModule", module)

    @staticmethod
    def _vertex_input(described: PipelineDescription) -> Any:
        return vk.new(
            "VkPipelineVertexInputStateCreateInfo",
            pVertexBindingDescriptions=[
                {"binding": location, "stride": 4 * floats, "inputRate": vk.VK_VERTEX_INPUT_RATE_VERTEX}
                for location, floats in described.streams
            ],
            pVertexAttributeDescriptions=[
                {"location": location, "binding": location, "format": _VERTEX_FORMATS[floats]}
                for location, floats in described.streams
            ],
        )

    @staticmethod
    def _depth(described: PipelineDescription) -> Any:
        # Reversed z: the near plane is 1, infinity 0, and nearer is greater. The fine steps of floats near 0 make up
        # for the coarse steps of 1/z there, so depth keeps its relative precision at any distance.
        compare = vk.VK_COMPARE_OP_EQUAL if described.depth == "equal" else vk.VK_COMPARE_OP_GREATER_OR_EQUAL
        return vk.new(
            "VkPipelineDepthStencilStateCreateInfo",
            depthTestEnable=int(described.depth is not None),
            depthWriteEnable=int(described.depth == "write"),
            depthCompareOp=compare,
        )

    @staticmethod
    def _blend(described: PipelineDescription) -> Any:
        if described.color is None:
            return vk.new("VkPipelineColorBlendStateCreateInfo")
        attachment: dict[str, Any] = {"colorWriteMask": _ALL_CHANNELS}
        if described.blend:
            over = described.blend == "over"
            source = vk.VK_BLEND_FACTOR_SRC_ALPHA if over else vk.VK_BLEND_FACTOR_ONE
            kept = vk.VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA if over else vk.VK_BLEND_FACTOR_ONE
            attachment |= {
                "blendEnable": 1,
                "srcColorBlendFactor": source,
                "dstColorBlendFactor": kept,
                "colorBlendOp": vk.VK_BLEND_OP_ADD,
                "srcAlphaBlendFactor": vk.VK_BLEND_FACTOR_ONE,
                "dstAlphaBlendFactor": kept,
                "alphaBlendOp": vk.VK_BLEND_OP_ADD,
            }
        return vk.new("VkPipelineColorBlendStateCreateInfo", pAttachments=[attachment])

    def close(self) -> None:
        """Free every pipeline and layout."""
        for built in self._built.values():
            self._device.destroy("VkPipeline", built.handle)
        for layout in self._layouts.values():
            self._device.destroy("VkPipelineLayout", layout)
