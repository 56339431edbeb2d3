"""Draws the lists of a user interface over a finished picture on Vulkan, with the same pixels as on OpenGL.

Colours are display codes and are blended as such, as every desktop does: source over target, straight alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import (
    Buffer,
    Image,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.shaders.compiler import compile_all
from common.paths import ROOT
from common.scene import Sampler
from common.view.draw_lists import GREY, VERTEX, DrawList, TextureUpdate

TEXTURES = 64
"""Textures at most."""

SHADERS = (ROOT / "shaders" / "draw_list.vert", ROOT / "shaders" / "draw_list.frag")

SAMPLER = Sampler("linear", "linear", None, "clamp", "clamp")

_STAGES = vk.VK_SHADER_STAGE_VERTEX_BIT | vk.VK_SHADER_STAGE_FRAGMENT_BIT
_POINT = vk.VK_PIPELINE_BIND_POINT_GRAPHICS


@dataclass
class _Texture:
    image: Image
    sets: Any  # VkDescriptorSet[1]


class DrawLists:
    """A pipeline for targets of one VkFormat, textures by number, and vertices once per slot of frames in flight."""

    def __init__(self, device: Device, format: int, slots: int) -> None:
        self._device = device
        self._textures: dict[int, _Texture] = {}
        self._vertices: list[Buffer | None] = [None] * slots
        self._indices: list[Buffer | None] = [None] * slots
        self._sampler = create_sampler(device, SAMPLER, 1.0, "user interface")
        binding = {
            "descriptorType": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
            "descriptorCount": 1,
            "stageFlags": vk.VK_SHADER_STAGE_FRAGMENT_BIT,
        }
        info = vk.new("VkDescriptorSetLayoutCreateInfo", pBindings=[binding])
        self._set_layout = device.create("vkCreateDescriptorSetLayout", info, "user interface")
        size = {"type": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, "descriptorCount": TEXTURES}
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            flags=vk.VK_DESCRIPTOR_POOL_CREATE_FREE_DESCRIPTOR_SET_BIT,
            maxSets=TEXTURES,
            pPoolSizes=[size],
        )
        self._pool = device.create("vkCreateDescriptorPool", info, "user interface")
        info = vk.new(
            "VkPipelineLayoutCreateInfo",
            pSetLayouts=[self._set_layout],
            pPushConstantRanges=[{"stageFlags": _STAGES, "size": 32}],
        )
        self._layout = device.create("vkCreatePipelineLayout", info, "user interface")
        self._pipeline = self._create_pipeline(format)

    def _create_pipeline(self, format: int) -> Any:
        device = self._device
        codes = compile_all([shader_text.build(path, "vulkan") for path in SHADERS])
        modules = [
            device.create(
                "vkCreateShaderModule", vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
            )
            for code in codes
        ]
        bits = (vk.VK_SHADER_STAGE_VERTEX_BIT, vk.VK_SHADER_STAGE_FRAGMENT_BIT)
        stages = [
            vk.new("VkPipelineShaderStageCreateInfo", stage=bit, module=module, pName="main")
            for bit, module in zip(bits, modules, strict=True)
        ]
        formats = (vk.VK_FORMAT_R32G32_SFLOAT, vk.VK_FORMAT_R32G32_SFLOAT, vk.VK_FORMAT_R8G8B8A8_UNORM)
        attributes = [
            {"location": location, "format": format_, "offset": VERTEX.fields[name][1]}
            for location, (name, format_) in enumerate(zip(VERTEX.names or (), formats, strict=True))
            if VERTEX.fields is not None
        ]
        over = vk.VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA
        blend = {
            "blendEnable": 1,
            "srcColorBlendFactor": vk.VK_BLEND_FACTOR_SRC_ALPHA,
            "dstColorBlendFactor": over,
            "srcAlphaBlendFactor": vk.VK_BLEND_FACTOR_ONE,
            "dstAlphaBlendFactor": over,
            "colorWriteMask": 15,
        }
        dynamic = [vk.VK_DYNAMIC_STATE_VIEWPORT, vk.VK_DYNAMIC_STATE_SCISSOR]
        info = vk.new(
            "VkGraphicsPipelineCreateInfo",
            pNext=vk.new("VkPipelineRenderingCreateInfo", pColorAttachmentFormats=[format]),
            pStages=stages,
            pVertexInputState={
                "pVertexBindingDescriptions": [{"stride": VERTEX.itemsize}],
                "pVertexAttributeDescriptions": attributes,
            },
            pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
            pViewportState={"viewportCount": 1, "scissorCount": 1},
            pRasterizationState={"polygonMode": vk.VK_POLYGON_MODE_FILL, "lineWidth": 1.0},
            pMultisampleState={"rasterizationSamples": vk.VK_SAMPLE_COUNT_1_BIT},
            pColorBlendState={"pAttachments": [blend]},
            pDynamicState={"pDynamicStates": dynamic},
            layout=self._layout,
        )
        infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
        pipeline = device.create_pipelines("vkCreateGraphicsPipelines", infos, ["user interface"])[0]
        for module in modules:
            device.destroy("VkShaderModule", module)
        return pipeline

    # --- textures ---

    def update(self, drawn: DrawList) -> None:
        """Take over the textures that a list brings and drop those that it gives up.

        Each copy is waited for: glyphs arrive in the first frames and then no more. A list must be given here once,
        drawn or not.
        """
        for update in drawn.updates:
            self.update_texture(update)
        for number in drawn.dropped:
            self._drop(number)

    def update_texture(self, update: TextureUpdate) -> None:
        """Copy pixels into a texture; one that is new or has another size must be given whole (ValueError)."""
        texture = self._textures.get(update.texture)
        if texture is not None and (texture.image.width, texture.image.height) != update.size:
            self._drop(update.texture)
            texture = None
        fresh = texture is None
        if texture is None:
            if not update.whole:
                raise ValueError(f"texture {update.texture} is new and was given in part")
            texture = self._textures[update.texture] = self._create_texture(update)
        device, image = self._device, texture.image
        height, width = update.pixels.shape[:2]
        staging = create_buffer(
            device,
            update.pixels.nbytes,
            vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
            "upload",
            "user interface pixels",
        )
        staging.mapped[: update.pixels.nbytes] = np.ascontiguousarray(update.pixels).reshape(-1)
        region = vk.new(
            "VkBufferImageCopy",
            imageSubresource={"aspectMask": image.aspect, "layerCount": 1},
            imageOffset={"x": update.x, "y": update.y},
            imageExtent={"width": width, "height": height, "depth": 1},
        )
        try:
            with submit_once(device) as commands:
                transition(device, commands, image, "undefined" if fresh else "sampled", "copy_target")
                layout = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
                device.fn.vkCmdCopyBufferToImage(commands, staging.handle, image.handle, layout, 1, region)
                transition(device, commands, image, "copy_target", "sampled")
        finally:
            destroy_buffer(device, staging)

    def _create_texture(self, update: TextureUpdate) -> _Texture:
        device = self._device
        if len(self._textures) == TEXTURES:
            raise ValueError(f"a user interface has {TEXTURES} textures at most")
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        image = create_image(device, "rgba8", update.size, usage, f"user interface texture {update.texture}")
        sets = vk.ffi.new("VkDescriptorSet[1]")
        info = vk.new(
            "VkDescriptorSetAllocateInfo", descriptorPool=self._pool, pSetLayouts=[self._set_layout]
        )
        vk.check(device.fn.vkAllocateDescriptorSets(device.handle, info, sets), "vkAllocateDescriptorSets")
        layout = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL
        write = vk.new(
            "VkWriteDescriptorSet",
            dstSet=sets[0],
            descriptorCount=1,
            descriptorType=vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
            pImageInfo=[{"sampler": self._sampler, "imageView": image.view, "imageLayout": layout}],
        )
        device.fn.vkUpdateDescriptorSets(
            device.handle, 1, vk.array("VkWriteDescriptorSet", [write]), 0, vk.NULL
        )
        return _Texture(image, sets)

    def _drop(self, number: int) -> None:
        texture = self._textures.pop(number, None)
        if texture is None:
            return
        self._device.wait_idle()  # a frame in flight may still show it
        code = self._device.fn.vkFreeDescriptorSets(self._device.handle, self._pool, 1, texture.sets)
        vk.check(code, "vkFreeDescriptorSets")
        destroy_image(self._device, texture.image)

    # --- drawing ---

    def record(self, commands: Any, slot: int, drawn: DrawList, view: Any, size: tuple[int, int]) -> None:
        """Record the drawing of a list over a target of (width, height), which is in state 'color' and stays in it.

        What was last recorded for `slot` must be done. ValueError for a texture that no `update` brought.
        """
        if not drawn.commands:
            return
        fn = self._device.fn
        vertices = self._fill(
            self._vertices, slot, drawn.vertices, vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT, "vertices"
        )
        indices = self._fill(
            self._indices, slot, drawn.indices, vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT, "indices"
        )
        extent = {"width": size[0], "height": size[1]}
        attachment = {
            "imageView": view,
            "imageLayout": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_LOAD,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
        }
        rendering = vk.new(
            "VkRenderingInfo",
            renderArea={"extent": extent},
            layerCount=1,
            pColorAttachments=[attachment],
        )
        fn.vkCmdBeginRendering(commands, rendering)
        fn.vkCmdBindPipeline(commands, _POINT, self._pipeline)
        viewport = vk.new("VkViewport", width=float(size[0]), height=float(size[1]), maxDepth=1.0)
        fn.vkCmdSetViewport(commands, 0, 1, viewport)
        fn.vkCmdBindVertexBuffers(
            commands, 0, 1, vk.array("VkBuffer", [vertices.handle]), vk.array("VkDeviceSize", [0])
        )
        fn.vkCmdBindIndexBuffer(commands, indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        push = np.zeros(8, np.uint32)
        push[:4] = drawn.transform().view(np.uint32)
        bound: int | None = None
        for command in drawn.commands:
            clip = drawn.scissor(command, size)
            if clip is None or not command.count:
                continue
            if command.texture != bound:
                bound = command.texture
                texture = self._textures.get(bound & ~GREY)
                if texture is None:
                    raise ValueError(f"a user interface uses texture {bound & ~GREY}, which it never gave")
                fn.vkCmdBindDescriptorSets(commands, _POINT, self._layout, 0, 1, texture.sets, 0, vk.NULL)
                push[4] = int(bool(bound & GREY))
                fn.vkCmdPushConstants(commands, self._layout, _STAGES, 0, 32, vk.ffi.from_buffer(push))
            x, y, width, height = clip
            scissor = vk.new("VkRect2D", offset={"x": x, "y": y}, extent={"width": width, "height": height})
            fn.vkCmdSetScissor(commands, 0, 1, scissor)
            fn.vkCmdDrawIndexed(commands, command.count, 1, command.first, command.base, 0)
        fn.vkCmdEndRendering(commands)

    def _fill(
        self, buffers: list[Buffer | None], slot: int, data: np.ndarray, usage: int, name: str
    ) -> Buffer:
        """Copy an array into a slot's buffer, which grows by doubling, and return that."""
        buffer = buffers[slot]
        if buffer is None or buffer.size < data.nbytes:
            if buffer is not None:
                destroy_buffer(self._device, buffer)
            size = max(1 << 16, 1 << (data.nbytes - 1).bit_length())
            buffer = create_buffer(self._device, size, usage, "upload", f"user interface {name}, slot {slot}")
            buffers[slot] = buffer
        buffer.mapped[: data.nbytes] = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
        return buffer

    def close(self) -> None:
        """Free everything, when nothing submitted uses it."""
        device = self._device
        for texture in self._textures.values():
            destroy_image(device, texture.image)
        self._textures.clear()
        for buffers in (self._vertices, self._indices):
            for buffer in buffers:
                if buffer is not None:
                    destroy_buffer(device, buffer)
            buffers.clear()
        device.destroy("VkPipeline", self._pipeline)
        device.destroy("VkPipelineLayout", self._layout)
        device.destroy("VkDescriptorPool", self._pool)
        device.destroy("VkDescriptorSetLayout", self._set_layout)
        device.destroy("VkSampler", self._sampler)
