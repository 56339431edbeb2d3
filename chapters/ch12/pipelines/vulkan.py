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

from ..rates.vulkan import rates_of_attachment
from .compute_description import ComputeDescription
from .description import Built, Described, PipelineDescription
from .ray_description import RayDescription
from .specialization import SUBGROUP_SIZE, Values
from .vulkan_cache import PipelineCache
from .vulkan_compute import build_compute, group_of, subgroup_size
from .vulkan_layouts import CAPACITY, Layouts
from .vulkan_rays import BindingTable, build_rays
from .vulkan_reflection import STAGES, Stage, check_pulled, chosen, merge

CHAPTER = Path(__file__).resolve().parents[1]

EXTENSIONS = {
    "bindless.glsl": "GL_EXT_nonuniform_qualifier",
    "tables.glsl": "GL_EXT_mesh_shader",
    "subgroups.glsl": "GL_KHR_shader_subgroup_arithmetic",
    "payload.glsl": "GL_EXT_ray_tracing",
    "query.glsl": "GL_EXT_ray_query",
}
"""The includes that need an extension: all textures, the tables of task and mesh shaders, a loop over lights, rays."""

_ALL_CHANNELS = (
    vk.VK_COLOR_COMPONENT_R_BIT
    | vk.VK_COLOR_COMPONENT_G_BIT
    | vk.VK_COLOR_COMPONENT_B_BIT
    | vk.VK_COLOR_COMPONENT_A_BIT
)


Defines = Sequence[tuple[str, int | float | str]]


def source_of(file: str, defines: Defines) -> shader_text.ShaderSource:
    """Return one of the chapter's shaders, ready for the compiler.

    A shader that includes the array of all textures gets the GLSL extension of `nonuniformEXT`. The extension has to
    come first in the text, where an include cannot put it.
    """
    return shader_text.build(
        CHAPTER / file,
        "vulkan",
        roots=(CHAPTER,),
        defines=dict(defines),
        extensions_with=EXTENSIONS,
        snippets=SNIPPETS,
    )


class Pipelines:
    """Builds pipelines at their first use and keeps them. All shaders get the additional `defines`.

    Shaders that declare specialization constants of the names in `constants` get these values.
    """

    def __init__(
        self,
        device: Device,
        cache: PipelineCache | None = None,
        capacity: int = CAPACITY,
        defines: Defines = (),
        constants: Values = (),
    ) -> None:
        self._device, self._cache, self._defines = device, cache, defines
        self._constants = (*constants, (SUBGROUP_SIZE, subgroup_size(device)))
        self._built: dict[Described, Built] = {}
        self.layouts = Layouts(device, capacity)

    def __len__(self) -> int:
        return len(self._built)

    def get(self, descriptions: Sequence[Described]) -> list[Built]:
        """Return one pipeline per description; the shaders of new pipelines are compiled together, on threads."""
        new = [described for described in dict.fromkeys(descriptions) if described not in self._built]
        for described, stages in zip(new, self._compile(new), strict=True):
            spirv = _stages(described, stages, self._constants)
            signature = merge(spirv, described.dynamic)
            layout, sets = self.layouts.pipeline(signature)
            push_stages = self.layouts.stages(signature.stages) if signature.push else 0
            handle, table = self._with_table(described, spirv, layout, self._cache)
            self._built[described] = Built(
                described, handle, stages, layout, sets, push_stages, group_of(spirv[0]), table
            )
        return [self._built[described] for described in descriptions]

    def _compile(self, descriptions: Sequence[Described], keep: bool = True) -> list[Stages]:
        sources = [
            [source_of(file, (*described.defines, *self._defines)) for file in described.shaders]
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
        handles: dict[Described, tuple[Any, BindingTable | None]] = {}
        try:
            for described in anew:
                # With the old layout: it has all that the new shaders use, and the bound sets were made for it.
                # Without the cache, which would keep every edit for ever.
                spirv = _stages(described, new[described], self._constants)
                handles[described] = self._with_table(described, spirv, old[described].layout)
        except BaseException:
            for handle, table in handles.values():
                self._free(handle, table)
            raise
        for described in anew:
            retire(partial(self._free, old[described].handle, old[described].table))
            old[described].handle, old[described].table = handles[described]
        for described, built in old.items():
            built.code = new[described]
            built.group = group_of(_stages(described, new[described], self._constants)[0])
        return tuple(described.title for described in anew)

    def _with_table(
        self, described: Described, spirv: Sequence[Stage], layout: Any, cache: PipelineCache | None = None
    ) -> tuple[Any, BindingTable | None]:
        """Return a pipeline, and the shader binding table of one that traces rays."""
        if isinstance(described, RayDescription):
            special = [_specialization(stage) for stage in spirv]
            return build_rays(self._device, described, spirv, special, layout, cache)
        return self._build(described, spirv, layout, cache), None

    def _free(self, handle: Any, table: BindingTable | None) -> None:
        self._device.destroy("VkPipeline", handle)
        if table is not None:
            table.close()

    def _build(
        self,
        described: PipelineDescription | ComputeDescription,
        spirv: Sequence[Stage],
        layout: Any,
        cache: PipelineCache | None = None,
    ) -> Any:
        if isinstance(described, ComputeDescription):
            return build_compute(self._device, described, spirv[0], _specialization(spirv[0]), layout, cache)
        special = [_specialization(stage) for stage in spirv]
        modules = [
            self._device.create(
                "vkCreateShaderModule",
                vk.new("VkShaderModuleCreateInfo", codeSize=len(stage.code), pCode=stage.code),
                file,
            )
            for file, stage in zip(described.shaders, spirv, strict=True)
        ]
        stages = [
            vk.new(
                "VkPipelineShaderStageCreateInfo",
                stage=STAGES[stage.name],
                module=module,
                pName="main",
                pSpecializationInfo=values,
            )
            for stage, module, values in zip(spirv, modules, special, strict=True)
        ]
        dynamic = [
            vk.VK_DYNAMIC_STATE_VIEWPORT,
            vk.VK_DYNAMIC_STATE_SCISSOR,
            vk.VK_DYNAMIC_STATE_CULL_MODE,
            vk.VK_DYNAMIC_STATE_FRONT_FACE,
        ]
        rendering = vk.new(
            "VkPipelineRenderingCreateInfo",
            pNext=rates_of_attachment() if described.by_rates else None,
            pColorAttachmentFormats=[FORMATS[name][0] for name in described.colors] or None,
            depthAttachmentFormat=FORMATS["d32f"][0] if described.depth else vk.VK_FORMAT_UNDEFINED,
        )
        info = vk.new(
            "VkGraphicsPipelineCreateInfo",
            pNext=rendering,
            flags=vk.VK_PIPELINE_CREATE_RENDERING_FRAGMENT_SHADING_RATE_ATTACHMENT_BIT_KHR
            * described.by_rates,
            pStages=stages,
            # Shaders fetch their vertices; mesh shaders ignore both states.
            pVertexInputState=vk.new("VkPipelineVertexInputStateCreateInfo"),
            pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
            pViewportState={"viewportCount": 1, "scissorCount": 1},
            pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
            pMultisampleState={"rasterizationSamples": described.samples},
            pDepthStencilState=self._depth(described),
            pColorBlendState=self._blend(described),
            pDynamicState={"pDynamicStates": dynamic},
            layout=layout,
        )
        infos = vk.array("VkGraphicsPipelineCreateInfo", [self._finished(described, info)])
        try:
            kept = cache.handle if cache else vk.NULL
            return self._device.create_pipelines("vkCreateGraphicsPipelines", infos, [described.title], kept)[
                0
            ]
        finally:
            for module in modules:
                self._device.destroy("VkShaderModule", module)

    @staticmethod
    def _finished(described: PipelineDescription, info: Any) -> Any:
        """Return what a pipeline is created from; studies add state to it."""
        return info

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
                # Behind blended surfaces alpha is 1. Each multiplies it by what it lets through.
                "srcAlphaBlendFactor": vk.VK_BLEND_FACTOR_ZERO if over else vk.VK_BLEND_FACTOR_ONE,
                "dstAlphaBlendFactor": kept,
                "alphaBlendOp": vk.VK_BLEND_OP_ADD,
            }
        if described.blend == "weighted":  # colours are added, the light that is left is multiplied
            attachment["srcAlphaBlendFactor"] = vk.VK_BLEND_FACTOR_ZERO
            attachment["dstAlphaBlendFactor"] = vk.VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA
        attachments = [attachment] * len(described.colors)
        return vk.new("VkPipelineColorBlendStateCreateInfo", pAttachments=attachments)

    def close(self) -> None:
        """Free every pipeline and layout."""
        for built in self._built.values():
            self._free(built.handle, built.table)
        self.layouts.close()


def _stages(described: Described, compiled: Stages, constants: Values) -> list[Stage]:
    """Return the reflected stages of a pipeline, with the values of their specialization constants."""
    spirv = [Stage(code, source) for code, source in zip(compiled.codes, compiled.sources, strict=True)]
    for stage in spirv:
        check_pulled(stage)
    return chosen(spirv, described.specialization, constants)


def _specialization(stage: Stage) -> Any:
    """Return the VkSpecializationInfo of a stage; None if all its constants keep their defaults."""
    values = dict(stage.constants)
    known = [constant for constant in stage.module.constants if constant.id in values]
    if not known:
        return None
    data = b"".join(constant.encoded(values[constant.id]) for constant in known)
    offsets = [sum(constant.size for constant in known[:number]) for number in range(len(known))]
    entries = [
        {"constantID": constant.id, "offset": offset, "size": constant.size}
        for constant, offset in zip(known, offsets, strict=True)
    ]
    return vk.new("VkSpecializationInfo", pMapEntries=entries, dataSize=len(data), pData=data)
