"""Getting data to the GPU: a ring of mapped staging memory, copies, and mip chains made on the GPU.

The ring has two halves. One is filled while the GPU still copies from the other, so loading never waits for a copy
that it could have overlapped. An array larger than a half goes up in parts, images by rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.resources import (
    FORMATS,
    Buffer,
    Image,
    create_buffer,
    create_level_views,
    destroy_buffer,
)
from backends.vulkan.shaders.compiler import compile_shader
from common.images import blocks
from common.paths import ROOT

HALF = 8 << 20
"""Bytes of one half of the ring."""

ALIGNMENT = 16
"""Offsets of copies: a multiple of the size of every texel and every block that is used."""

MOST_LEVELS = 32
"""Of an image: the sides of its levels are numbers of 32 bits, halved."""

SETS = 1024
"""Mip levels that may be made between two waits."""

PUSH_BYTES = 20
"""Push constants of `shaders/mips.comp`: sizes of a level and of the one above, and the highest code."""


class _Half:
    """One half of the ring: its memory, its command buffer, and the fence that says when both are free again."""

    def __init__(self, device: Device, number: int) -> None:
        self.buffer = create_buffer(
            device, HALF, vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, "upload", f"upload ring, half {number}"
        )
        pool_info = vk.new(
            "VkCommandPoolCreateInfo",
            flags=vk.VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
            queueFamilyIndex=device.queue.family,
        )
        self.pool = device.create("vkCreateCommandPool", pool_info, "upload commands")
        info = vk.new("VkCommandBufferAllocateInfo", commandPool=self.pool, commandBufferCount=1)
        out = vk.ffi.new("VkCommandBuffer[1]")
        vk.check(device.fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
        self.commands = out[0]
        self.fence = device.create("vkCreateFence", vk.new("VkFenceCreateInfo"), "upload done")
        self.busy = False
        self.open = False
        self.used = 0
        self.sets: Any = None
        self.set_count = 0

    def close(self, device: Device) -> None:
        destroy_buffer(device, self.buffer)
        device.destroy("VkCommandPool", self.pool)
        device.destroy("VkFence", self.fence)
        if self.sets is not None:
            device.destroy("VkDescriptorPool", self.sets)


class Uploader:
    """Copies arrays into buffers and images. `flush` submits; nothing is there before `finish`, which waits."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._halves = [_Half(device, 0), _Half(device, 1)]
        self._current = 0
        self._mips: dict[tuple[str, bool], MipPipeline] = {}
        self._begin_info = vk.new(
            "VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT
        )
        self.bytes = 0

    def __enter__(self) -> Uploader:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.finish()
        self.close()

    def buffer(self, target: Buffer, data: np.ndarray, offset: int = 0) -> None:
        """Copy the bytes of `data` to `target` from byte `offset` on."""
        raw = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
        if offset + raw.size > target.size:
            raise ValueError(
                f"{raw.size} bytes at {offset} do not fit into '{target.name}' of {target.size} bytes."
            )
        done = 0
        while done < raw.size:
            half, start, count = self._reserve(raw.size - done, 1)
            half.buffer.mapped[start : start + count] = raw[done : done + count]
            region = vk.new("VkBufferCopy", srcOffset=start, dstOffset=offset + done, size=count)
            self._device.fn.vkCmdCopyBuffer(half.commands, half.buffer.handle, target.handle, 1, region)
            done += count

    def image(
        self,
        target: Image,
        pixels: np.ndarray | Sequence[np.ndarray],
        *,
        mips: bool = True,
        srgb: bool = False,
    ) -> None:
        """Copy (H, W, C) pixels to level 0, make the other levels if `mips`, and leave the image ready for sampling.

        `pixels` has the type and channels of the image's format, one array for each layer of an array or slice of a 3D
        image; `srgb` says that colour is to be averaged as light.
        """
        if blocks.is_compressed(target.format):
            raise ValueError(f"'{target.name}' holds blocks, not pixels: its levels go up by `chain`.")
        _, texel, dtype, channels = FORMATS[target.format]
        expected = (target.height, target.width, channels)
        layers = [pixels] if isinstance(pixels, np.ndarray) else pixels
        count = target.depth or target.layers
        if len(layers) != count:
            raise ValueError(f"'{target.name}' has {count} layers, and {len(layers)} were given.")
        for layer in layers:
            if layer.shape != expected or layer.dtype != dtype:
                raise ValueError(
                    f"'{target.name}' wants {expected} {np.dtype(dtype)}, not {layer.shape} {layer.dtype}."
                )
        row = target.width * texel
        self._barrier(self._half().commands, target, "undefined", "copy_target")
        for number, layer in enumerate(layers):
            rows = np.ascontiguousarray(layer).view(np.uint8).reshape(target.height, row)
            self._copy_rows(target, number, 0, rows)
        commands = self._half().commands
        self._barrier(commands, target, "copy_target", "sampled", 0, 1)
        if target.levels > 1:
            if not mips:
                raise ValueError(f"'{target.name}' has {target.levels} levels, and only one was given.")
            self._make_mips(target, srgb)

    def chain(self, target: Image, layers: Sequence[Sequence[np.ndarray]]) -> None:
        """Copy mip levels that were made before, and leave the image ready for sampling.

        `layers` holds, for each layer, all levels of the image, the largest first: (rows, bytes of a row) uint8, where
        rows are of blocks if the format is of blocks, and else of texels. A level that does not fit into the ring goes
        up by rows.
        """
        if target.depth is not None or len(layers) != target.layers:
            raise ValueError(f"'{target.name}' has {target.layers} layers, and {len(layers)} were given.")
        for levels in layers:
            if len(levels) != target.levels:
                raise ValueError(f"'{target.name}' has {target.levels} levels, and {len(levels)} were given.")
            for level, rows in enumerate(levels):
                expected = stored_shape(target, level)
                if rows.shape != expected or rows.dtype != np.uint8:
                    raise ValueError(
                        f"Level {level} of '{target.name}' wants {expected} uint8, not {rows.shape} {rows.dtype}."
                    )
        self._barrier(self._half().commands, target, "undefined", "copy_target")
        for layer, levels in enumerate(layers):
            for level, rows in enumerate(levels):
                self._copy_rows(target, layer, level, rows)
        self._barrier(self._half().commands, target, "copy_target", "sampled")

    def _copy_rows(self, target: Image, layer: int, level: int, rows: np.ndarray) -> None:
        """Copy (rows, bytes of a row) to a level of a layer or slice, in as many pieces as the ring asks for."""
        slice_ = layer if target.depth is not None else 0
        width, height = max(1, target.width >> level), max(1, target.height >> level)
        texels = blocks.BLOCK if blocks.is_compressed(target.format) else 1  # that a row is high
        done = 0
        while done < len(rows):
            half, start, count = self._reserve((len(rows) - done) * rows.shape[1], rows.shape[1])
            some = count // rows.shape[1]
            half.buffer.mapped[start : start + some * rows.shape[1]] = rows[done : done + some].reshape(-1)
            region = vk.new(
                "VkBufferImageCopy",
                bufferOffset=start,
                imageSubresource={
                    "aspectMask": target.aspect,
                    "mipLevel": level,
                    "baseArrayLayer": layer - slice_,
                    "layerCount": 1,
                },
                imageOffset={"x": 0, "y": done * texels, "z": slice_},
                imageExtent={
                    "width": width,
                    "height": min(some * texels, height - done * texels),  # the last blocks may reach beyond
                    "depth": 1,
                },
            )
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
            fn = self._device.fn
            fn.vkCmdCopyBufferToImage(half.commands, half.buffer.handle, target.handle, layout, 1, region)
            done += some

    def _barrier(
        self, commands: Any, image: Image, before: str, after: str, level: int = 0, levels: int | None = None
    ) -> None:
        dependency = barriers(image_barrier(image.handle, image.aspect, before, after, level, levels))
        self._device.fn.vkCmdPipelineBarrier2(commands, dependency)

    def _make_mips(self, image: Image, srgb: bool) -> None:
        plain = "rgba8" if image.format == "rgba8_srgb" else image.format
        key = (plain, image.array)
        pipeline = self._mips.get(key)
        if pipeline is None:
            pipeline = self._mips[key] = MipPipeline(self._device, *key)
        if self._half().set_count + image.levels > SETS:
            self.flush()
        half = self._half()
        if half.sets is None:
            half.sets = pipeline.create_pool()
        self._barrier(half.commands, image, "copy_target", "storage", 1)
        pipeline.record(half.commands, half.sets, image, plain, srgb)
        half.set_count += image.levels - 1

    def _half(self) -> _Half:
        """Return the half being filled, open for recording; wait for the GPU if it still copies from it."""
        half = self._halves[self._current]
        if half.open:
            return half
        fn, device = self._device.fn, self._device.handle
        if half.busy:
            fences = vk.array("VkFence", [half.fence])
            vk.check(fn.vkWaitForFences(device, 1, fences, 1, 2**64 - 1), "vkWaitForFences")
            vk.check(fn.vkResetFences(device, 1, fences), "vkResetFences")
            half.busy = False
        vk.check(fn.vkResetCommandPool(device, half.pool, 0), "vkResetCommandPool")
        if half.sets is not None:
            vk.check(fn.vkResetDescriptorPool(device, half.sets, 0), "vkResetDescriptorPool")
        half.used = half.set_count = 0
        vk.check(fn.vkBeginCommandBuffer(half.commands, self._begin_info), "vkBeginCommandBuffer")
        half.open = True
        return half

    def _reserve(self, size: int, unit: int) -> tuple[_Half, int, int]:
        """Return (half, offset, bytes): room for a multiple of `unit` bytes, at most `size`; submits if need be."""
        if unit > HALF:
            raise ValueError(f"One row of {unit} bytes does not fit into the upload ring.")
        half = self._half()
        if HALF - half.used < unit:
            self.flush()
            half = self._half()
        count = min(size, (HALF - half.used) // unit * unit)
        start = half.used
        half.used = min(HALF, (start + count + ALIGNMENT - 1) // ALIGNMENT * ALIGNMENT)
        self.bytes += count
        return half, start, count

    def flush(self) -> None:
        """Submit what was recorded, and go on with the other half of the ring."""
        half = self._halves[self._current]
        if not half.open:
            return
        fn = self._device.fn
        # Whatever reads the data next runs in a later submission; this makes the writes visible to all of it.
        write = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
        read = (vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, vk.VK_ACCESS_2_MEMORY_READ_BIT)
        fn.vkCmdPipelineBarrier2(half.commands, barriers(memory=(*write, *read)))
        vk.check(fn.vkEndCommandBuffer(half.commands), "vkEndCommandBuffer")
        submit = vk.new("VkSubmitInfo2", pCommandBufferInfos=[{"commandBuffer": half.commands}])
        vk.check(fn.vkQueueSubmit2(self._device.queue.handle, 1, submit, half.fence), "vkQueueSubmit2")
        half.open, half.busy = False, True
        self._current = 1 - self._current

    def finish(self) -> None:
        """Submit what was recorded and wait until everything has arrived."""
        self.flush()
        for half in self._halves:
            if half.busy:
                fences = vk.array("VkFence", [half.fence])
                code = self._device.fn.vkWaitForFences(self._device.handle, 1, fences, 1, 2**64 - 1)
                vk.check(code, "vkWaitForFences")

    def close(self) -> None:
        """Free the ring, when the GPU copies nothing from it any more."""
        self._device.wait_idle()
        self.free()

    def free(self) -> None:
        """Free the ring at once: all copies have ended."""
        for half in self._halves:
            half.close(self._device)
        for pipeline in self._mips.values():
            pipeline.close()


def stored_shape(image: Image, level: int) -> tuple[int, int]:
    """Return (rows, bytes of a row) of a level, as `Uploader.chain` takes it."""
    width, height = max(1, image.width >> level), max(1, image.height >> level)
    return blocks.stored_shape(image.format, width, height, FORMATS[image.format][1])


class MipPipeline:
    """The compute pipelines of `shaders/mips.comp` for images of one format, or arrays of them.

    There is one for colour that is sRGB-coded and one for all else, each made when it is needed first, or by `build`.
    """

    def __init__(self, device: Device, format: str, layered: bool) -> None:
        self._device, self._format, self._layered = device, format, layered
        self._pipelines: dict[bool, Any] = {}
        self._sampler = device.create("vkCreateSampler", vk.new("VkSamplerCreateInfo"), "texel fetches")
        stage = vk.VK_SHADER_STAGE_COMPUTE_BIT
        bindings = [
            {
                "binding": 0,
                "descriptorType": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                "descriptorCount": 1,
            },
            {"binding": 1, "descriptorType": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE, "descriptorCount": 1},
        ]
        info = vk.new(
            "VkDescriptorSetLayoutCreateInfo", pBindings=[{**b, "stageFlags": stage} for b in bindings]
        )
        self._set_layout = device.create("vkCreateDescriptorSetLayout", info, "mips")
        info = vk.new(
            "VkPipelineLayoutCreateInfo",
            pSetLayouts=[self._set_layout],
            pPushConstantRanges=[{"stageFlags": stage, "size": PUSH_BYTES}],
        )
        self._layout = device.create("vkCreatePipelineLayout", info, "mips")
        self._make_ahead()

    def build(self, srgb: bool) -> Any:
        """Return the pipeline for colour that is sRGB-coded, or for all else."""
        if srgb in self._pipelines:
            return self._pipelines[srgb]
        device = self._device
        defines: dict[str, int | str] = {"FORMAT": self._format}
        defines |= {name: 1 for name, on in (("LAYERED", self._layered), ("SRGB", srgb)) if on}
        source = shader_text.build(ROOT / "shaders" / "mips.comp", "vulkan", defines=defines)
        code = compile_shader(source)
        module = device.create(
            "vkCreateShaderModule", vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
        )
        infos = vk.array(
            "VkComputePipelineCreateInfo",
            [
                vk.new(
                    "VkComputePipelineCreateInfo",
                    stage=vk.new(
                        "VkPipelineShaderStageCreateInfo",
                        stage=vk.VK_SHADER_STAGE_COMPUTE_BIT,
                        module=module,
                        pName="main",
                    ),
                    layout=self._layout,
                )
            ],
        )
        name = f"mips {self._format}{', sRGB' if srgb else ''}"
        self._pipelines[srgb] = device.create_pipelines("vkCreateComputePipelines", infos, [name])[0]
        device.destroy("VkShaderModule", module)
        return self._pipelines[srgb]

    def create_pool(self) -> Any:
        """Return a pool for the descriptor sets of SETS levels."""
        sizes = [
            {"type": vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, "descriptorCount": SETS},
            {"type": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE, "descriptorCount": SETS},
        ]
        info = vk.new("VkDescriptorPoolCreateInfo", maxSets=SETS, pPoolSizes=sizes)
        return self._device.create("vkCreateDescriptorPool", info, "mips")

    def record(
        self,
        commands: Any,
        pool: Any,
        image: Image,
        format: str,
        srgb: bool,
        layer: int = 0,
        layers: int | None = None,
    ) -> None:
        """Record the making of levels 1 and up, in state 'storage', from level 0, 'sampled'; all end as that.

        Of an array, `layers` layers from `layer` on (all by default).
        """
        fn = self._device.fn
        layers = image.layers - layer if layers is None else layers
        count = image.levels - 1
        self._allocate.descriptorPool, self._allocate.descriptorSetCount = pool, count
        sets = self._sets
        code = fn.vkAllocateDescriptorSets(self._device.handle, self._allocate, sets)
        vk.check(code, "vkAllocateDescriptorSets")
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_STORAGE_BIT
        views = create_level_views(self._device, image, format, layer=layer, layers=layers, usage=usage)
        self._write_sets(sets, views)
        dependency = barriers(image_barrier(image.handle, image.aspect, "storage", "sampled", levels=1))
        written = dependency.pImageMemoryBarriers[0].subresourceRange
        written.baseArrayLayer, written.layerCount = layer, layers
        push, layout = self._push, self._layout
        point, stage = vk.VK_PIPELINE_BIND_POINT_COMPUTE, vk.VK_SHADER_STAGE_COMPUTE_BIT
        push[4] = 255 if FORMATS[format][2] is np.uint8 else 0
        width, height = image.width, image.height
        fn.vkCmdBindPipeline(commands, point, self.build(srgb))
        for level in range(1, image.levels):
            fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets + level - 1, 0, vk.NULL)
            above, width, height = (width, height), max(1, width >> 1), max(1, height >> 1)
            push[0:4] = [width, height, *above]
            fn.vkCmdPushConstants(commands, layout, stage, 0, PUSH_BYTES, push)
            fn.vkCmdDispatch(commands, (width + 7) // 8, (height + 7) // 8, layers)
            written.baseMipLevel = level
            fn.vkCmdPipelineBarrier2(commands, dependency)

    def _make_ahead(self) -> None:
        """Make what every image fills in and hands over: a scene has hundreds, and new structs take longer."""
        sampled, stored = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL, vk.VK_IMAGE_LAYOUT_GENERAL
        kinds = (vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE)
        self._allocate = vk.new("VkDescriptorSetAllocateInfo", pSetLayouts=[self._set_layout] * MOST_LEVELS)
        self._sets = vk.ffi.new("VkDescriptorSet[]", MOST_LEVELS)
        self._push = vk.ffi.new("uint32_t[]", PUSH_BYTES // 4)
        images = self._images = vk.ffi.new("VkDescriptorImageInfo[]", 2 * MOST_LEVELS)
        writes = self._writes = vk.ffi.new("VkWriteDescriptorSet[]", 2 * MOST_LEVELS)
        for number in range(2 * MOST_LEVELS):
            binding, write = number % 2, writes[number]
            images[number].imageLayout = stored if binding else sampled
            images[number].sampler = vk.NULL if binding else self._sampler
            write.sType = vk.VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET
            write.dstBinding, write.descriptorCount, write.descriptorType = binding, 1, kinds[binding]
            write.pImageInfo = images + number

    def _write_sets(self, sets: Any, views: list[Any]) -> None:
        """Let each set read the view above its level and write its own, all at once."""
        images, writes, count = self._images, self._writes, 2 * (len(views) - 1)
        for number in range(count):
            images[number].imageView = views[(number + 1) // 2]
            writes[number].dstSet = sets[number // 2]
        self._device.fn.vkUpdateDescriptorSets(self._device.handle, count, writes, 0, vk.NULL)

    def close(self) -> None:
        """Free the pipeline."""
        for pipeline in self._pipelines.values():
            self._device.destroy("VkPipeline", pipeline)
        self._device.destroy("VkPipelineLayout", self._layout)
        self._device.destroy("VkDescriptorSetLayout", self._set_layout)
        self._device.destroy("VkSampler", self._sampler)
