"""The workbench of the self-tests: buffers, textures, descriptors, one dispatch, one draw; all freed at its end.

Nothing is kept or shared between calls, since a self-test makes one or two of them. Small pieces of GLSL are given as
text; what they compute is compared with numbers made in Python.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.selftest.data import FULL_SCREEN as FULL_SCREEN
from backends.selftest.data import UNSET as UNSET
from backends.selftest.data import Computation
from backends.selftest.data import differ as differ
from backends.shader_text import build_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, transition
from backends.vulkan.device import Device
from backends.vulkan.instance import Instance
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import (
    FORMATS,
    Buffer,
    Image,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.selftests import bindings
from backends.vulkan.selftests.bindings import Resource, Texture
from backends.vulkan.shaders.compiler import compile_shader

STAGES = {
    "vert": vk.VK_SHADER_STAGE_VERTEX_BIT,
    "frag": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
    "comp": vk.VK_SHADER_STAGE_COMPUTE_BIT,
    "task": vk.VK_SHADER_STAGE_TASK_BIT_EXT,
    "mesh": vk.VK_SHADER_STAGE_MESH_BIT_EXT,
    "rgen": vk.VK_SHADER_STAGE_RAYGEN_BIT_KHR,
    "rmiss": vk.VK_SHADER_STAGE_MISS_BIT_KHR,
    "rchit": vk.VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR,
}

EVERYTHING = (
    vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
    vk.VK_ACCESS_2_MEMORY_WRITE_BIT,
    vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT | vk.VK_PIPELINE_STAGE_2_HOST_BIT,
    vk.VK_ACCESS_2_MEMORY_READ_BIT | vk.VK_ACCESS_2_MEMORY_WRITE_BIT | vk.VK_ACCESS_2_HOST_READ_BIT,
)
"""A memory barrier over everything: simple, and slower than a precise one."""

BUFFER_USAGE = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
)


@dataclass(frozen=True)
class Program:
    """A pipeline with its layout and the set of what it reads and writes."""

    pipeline: Any
    layout: Any
    set: Any
    bind_point: int


class Session:
    """Device `number` of the loader's list with all that its driver advertises, for the benches of a process."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._open = ExitStack()

    def __enter__(self) -> Session:
        instance = self._open.enter_context(Instance())
        physical = instance.devices()[self._number]
        self._device = self._open.enter_context(Device(instance, physical, believe=True))
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def bench(self) -> Bench:
        """Return an empty bench."""
        return Bench(self._device)


class Bench:
    """Makes what a self-test needs on `device`, and frees it."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.fn = device.fn
        self._free: list[Callable[[], None]] = []

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.device.wait_idle()
        for free in reversed(self._free):
            free()

    def at_end(self, free: Callable[..., None], *arguments: Any) -> None:
        """Call `free(*arguments)` at the end, last given first."""
        self._free.append(lambda: free(*arguments))

    def make(self, call: str, struct: str, **fields: Any) -> Any:
        """Return what `vkCreate...` makes of a struct with `fields`."""
        handle = self.device.create(call, vk.new(struct, **fields), "selftest")
        self.at_end(self.device.destroy, "Vk" + call.removeprefix("vkCreate"), handle)
        return handle

    # --- buffers and textures ---

    def input(self, data: np.ndarray, usage: int = 0) -> Buffer:
        """Return a buffer with `data`, for storage or indirect arguments."""
        buffer = create_buffer(self.device, data.nbytes, BUFFER_USAGE | usage, "upload", "input")
        self.at_end(destroy_buffer, self.device, buffer)
        buffer.mapped[: data.nbytes] = np.frombuffer(data.tobytes(), np.uint8)
        return buffer

    def output(self, words: int) -> Buffer:
        """Return a buffer of `words` 32-bit words, each UNSET, for `read`."""
        buffer = create_buffer(self.device, 4 * words, BUFFER_USAGE, "readback", "output")
        self.at_end(destroy_buffer, self.device, buffer)
        with self.submit() as commands:
            self.fn.vkCmdFillBuffer(commands, buffer.handle, 0, vk.VK_WHOLE_SIZE, UNSET)
            self.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
        return buffer

    def read(self, buffer: Buffer, dtype: Any) -> np.ndarray:
        """Return a copy of what the GPU wrote to an output."""
        self.device.memory.invalidate(buffer.allocation)
        return buffer.view(dtype).copy()

    def image(self, format: str, size: tuple[int, int], usage: int) -> Image:
        """Return an image that can be copied from and to as well."""
        copies = vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        image = create_image(self.device, format, size, usage | copies, "selftest")
        self.at_end(destroy_image, self.device, image)
        return image

    def fill(self, image: Any, size: tuple[int, int], data: np.ndarray, levels: int = 1) -> None:
        """Write `data` into an image whose level 0 is of `size`, and make it ready to be sampled.

        With `levels` above 1 the image is a chain of mip levels, and `data` their texels in order; else the first axis
        of a three-dimensional `data` counts layers.
        """
        buffer = self.input(data)
        width, height = size
        layers = data.shape[0] if levels == 1 and data.ndim == 3 else 1
        regions, offset = [], 0
        for level in range(levels):
            extent = {"width": max(width >> level, 1), "height": max(height >> level, 1), "depth": 1}
            part = {
                "aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT,
                "mipLevel": level,
                "layerCount": layers,
            }
            regions.append({"bufferOffset": offset, "imageSubresource": part, "imageExtent": extent})
            offset += data.itemsize * extent["width"] * extent["height"]
        copies = vk.array("VkBufferImageCopy", regions)
        layout = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
        with self.submit() as commands:
            self.move(commands, image, vk.VK_IMAGE_LAYOUT_UNDEFINED, layout)
            self.fn.vkCmdCopyBufferToImage(commands, buffer.handle, image, layout, len(regions), copies)
            self.move(commands, image, layout, vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL)

    def move(
        self, commands: Any, image: Any, before: int, after: int, aspect: int = vk.VK_IMAGE_ASPECT_COLOR_BIT
    ) -> None:
        """Record a barrier for all of an image, from one layout to another, that waits for everything."""
        stages, writes = EVERYTHING[:2]
        barrier = vk.new(
            "VkImageMemoryBarrier2",
            srcStageMask=stages,
            srcAccessMask=writes,
            dstStageMask=stages,
            dstAccessMask=vk.VK_ACCESS_2_MEMORY_READ_BIT | vk.VK_ACCESS_2_MEMORY_WRITE_BIT,
            oldLayout=before,
            newLayout=after,
            srcQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
            dstQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
            image=image,
            subresourceRange={
                "aspectMask": aspect,
                "levelCount": vk.VK_REMAINING_MIP_LEVELS,
                "layerCount": vk.VK_REMAINING_ARRAY_LAYERS,
            },
        )
        self.fn.vkCmdPipelineBarrier2(commands, barriers(barrier))

    def sampler(self, **fields: Any) -> Any:
        """Return a sampler that clamps and takes the nearest texel, but for `fields`."""
        edge = vk.VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE
        modes = {"addressModeU": edge, "addressModeV": edge, "addressModeW": edge}
        return self.make("vkCreateSampler", "VkSamplerCreateInfo", **{**modes, **fields})

    def texture(self, format: str, data: np.ndarray, sampler: Any = None) -> Texture:
        """Return a 2D texture of one level with `data` (H, W)."""
        size = (data.shape[1], data.shape[0])
        image = self.image(format, size, vk.VK_IMAGE_USAGE_SAMPLED_BIT)
        self.fill(image.handle, size, data)
        return Texture(image.view, sampler if sampler is not None else self.sampler())

    def mipmapped(self, levels: Sequence[np.ndarray], **how: float) -> Texture:
        """Return a 2D texture (rgba8) of mip levels, (H, W) uint32; the nearest texels of two levels are mixed.

        `how` are further fields of its sampler.
        """
        size = (levels[0].shape[1], levels[0].shape[0])
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        image = create_image(self.device, "rgba8", size, usage, "selftest", levels=len(levels))
        self.at_end(destroy_image, self.device, image)
        self.fill(image.handle, size, np.concatenate([level.ravel() for level in levels]), levels=len(levels))
        mix = vk.VK_SAMPLER_MIPMAP_MODE_LINEAR
        return Texture(image.view, self.sampler(mipmapMode=mix, maxLod=vk.VK_LOD_CLAMP_NONE, **how))

    # --- programs ---

    def submit(self) -> Any:
        """Give a command buffer that is submitted and waited for at the end of a `with` block."""
        return submit_once(self.device)

    def stages(self, sources: Mapping[str, str], extensions: Sequence[str] = ()) -> list[Any]:
        """Return the stages of GLSL texts by stage ("comp", "frag"); needs glslang or its cache."""
        stages = []
        for stage, text in sources.items():
            code = compile_shader(build_text(text, stage, "vulkan", name=stage, extensions=extensions))
            module = self.make(
                "vkCreateShaderModule", "VkShaderModuleCreateInfo", codeSize=len(code), pCode=code
            )
            stages.append({"stage": STAGES[stage], "module": module, "pName": "main"})
        return stages

    def compute(self, source: str, resources: Sequence[Resource], extensions: Sequence[str] = ()) -> Program:
        """Return a compute program of one GLSL text."""
        layout, bound = bindings.layout(self, resources)
        stage = self.stages({"comp": source}, extensions)[0]
        infos = vk.array("VkComputePipelineCreateInfo", [{"stage": stage, "layout": layout}])
        pipeline = self.device.create_pipelines("vkCreateComputePipelines", infos, ["selftest"])[0]
        self.at_end(self.device.destroy, "VkPipeline", pipeline)
        return Program(pipeline, layout, bound, vk.VK_PIPELINE_BIND_POINT_COMPUTE)

    def dispatch(
        self,
        source: str,
        resources: Sequence[Resource],
        groups: int = 1,
        extensions: Sequence[str] = (),
    ) -> None:
        """Run a compute shader once and wait."""
        program = self.compute(source, resources, extensions)
        with self.submit() as commands:
            self.bind(commands, program)
            self.fn.vkCmdDispatch(commands, groups, 1, 1)
            self.fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))

    def computes(self, work: Computation, extensions: Sequence[str] = ()) -> str:
        """Return what is wrong with the results of `work`, or ""."""
        output = self.output(work.words)
        self.dispatch(work.source, [self.input(work.input), output], work.groups, extensions)
        return work.wrong(self.read(output, work.expected.dtype))

    def graphics(
        self,
        sources: Mapping[str, str],
        resources: Sequence[Resource] = (),
        *,
        extensions: Sequence[str] = (),
        target: str = "r32ui",
        polygon_mode: int = vk.VK_POLYGON_MODE_FILL,
        rate: Any = None,
        push: int = 0,
    ) -> Program:
        """Return a program that draws triangles into one target.

        `rate` is a shading-rate state to chain, `push` the number of bytes of push constants, for all stages.
        """
        layout, bound = bindings.layout(self, resources, push)
        depth = target == "d32f"
        rendering = vk.new(
            "VkPipelineRenderingCreateInfo",
            pNext=rate,
            pColorAttachmentFormats=None if depth else [FORMATS[target][0]],
            depthAttachmentFormat=FORMATS[target][0] if depth else vk.VK_FORMAT_UNDEFINED,
        )
        flags = vk.VK_PIPELINE_CREATE_RENDERING_FRAGMENT_SHADING_RATE_ATTACHMENT_BIT_KHR if rate else 0
        blend = None if depth else [{"colorWriteMask": 0xF}]
        dynamic = [vk.VK_DYNAMIC_STATE_VIEWPORT, vk.VK_DYNAMIC_STATE_SCISSOR]
        classic = "vert" in sources
        infos = vk.array(
            "VkGraphicsPipelineCreateInfo",
            [
                {
                    "pNext": rendering,
                    "flags": flags,
                    "pStages": self.stages(sources, extensions),
                    "pVertexInputState": {} if classic else None,
                    "pInputAssemblyState": {"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST}
                    if classic
                    else None,
                    "pViewportState": {"viewportCount": 1, "scissorCount": 1},
                    "pRasterizationState": {"polygonMode": polygon_mode, "lineWidth": 1.0},
                    "pMultisampleState": {"rasterizationSamples": vk.VK_SAMPLE_COUNT_1_BIT},
                    "pDepthStencilState": {
                        "depthTestEnable": int(depth),
                        "depthWriteEnable": int(depth),
                        "depthCompareOp": vk.VK_COMPARE_OP_ALWAYS,
                    },
                    "pColorBlendState": {"pAttachments": blend},
                    "pDynamicState": {"pDynamicStates": dynamic},
                    "layout": layout,
                }
            ],
        )
        pipeline = self.device.create_pipelines("vkCreateGraphicsPipelines", infos, ["selftest"])[0]
        self.at_end(self.device.destroy, "VkPipeline", pipeline)
        return Program(pipeline, layout, bound, vk.VK_PIPELINE_BIND_POINT_GRAPHICS)

    def render(
        self,
        program: Program,
        size: tuple[int, int],
        record: Callable[[Any], None],
        rate: Any = None,
    ) -> np.ndarray:
        """Return (H, W) uint32: 0, and what `record(commands)` draws into an r32ui target of `size`."""
        image = self.image("r32ui", size, vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT)
        with self.submit() as commands:
            transition(self.device, commands, image, "undefined", "color")
            self.draw(commands, program, image.view, size, record, rate=rate)
            transition(self.device, commands, image, "color", "copy_source")
        return read_image(self.device, image, "copy_source")

    def draw(
        self,
        commands: Any,
        program: Program,
        view: Any,
        size: tuple[int, int],
        record: Callable[[Any], None],
        *,
        depth: bool = False,
        rate: Any = None,
    ) -> None:
        """Record a rendering into a cleared target; `rate` is a shading-rate attachment to chain."""
        width, height = size
        area = {"extent": {"width": width, "height": height}}
        layout = (
            vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL
            if depth
            else vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL
        )
        target = {
            "imageView": view,
            "imageLayout": layout,
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
        }
        info = vk.new(
            "VkRenderingInfo",
            pNext=rate,
            renderArea=area,
            layerCount=1,
            pColorAttachments=None if depth else [target],
            pDepthAttachment=target if depth else None,
        )
        self.fn.vkCmdBeginRendering(commands, info)
        self.bind(commands, program)
        viewport = vk.new("VkViewport", width=width, height=height, maxDepth=1.0)
        self.fn.vkCmdSetViewport(commands, 0, 1, viewport)
        self.fn.vkCmdSetScissor(commands, 0, 1, vk.new("VkRect2D", **area))
        record(commands)
        self.fn.vkCmdEndRendering(commands)

    def bind(self, commands: Any, program: Program) -> None:
        """Record the binding of a program and of its resources."""
        self.fn.vkCmdBindPipeline(commands, program.bind_point, program.pipeline)
        sets = vk.array("VkDescriptorSet", [program.set])
        self.fn.vkCmdBindDescriptorSets(commands, program.bind_point, program.layout, 0, 1, sets, 0, vk.NULL)
