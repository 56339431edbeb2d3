"""Depth images as textures, and the pyramid that a chapter's kernel makes of one, on either backend.

`kernels` is what `tests.support.kernels.kernels_on` yields, `layout` a `PyramidLayout` of the chapter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl import resources as gl_resources
from backends.gl import targets as gl_targets
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import (
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.upload import Uploader
from common.scene import Sampler
from tests.support.kernels import GlKernels

SAMPLE = """
layout(location = 0) out float value;
layout(BIND(0, 0, 0)) readonly buffer Values_ { float values[]; };
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    value = values[(pixel.y * WIDTH + pixel.x) * SAMPLES + NUMBER];
    gl_SampleMask[0] = 1 << NUMBER;
}
"""
"""Draws one sample of every pixel: an image of several samples cannot be uploaded."""

POISON = np.float32(-7.0)
"""The content of the buffer before the dispatches: a word that none of them writes keeps it."""

SPARE = 64
"""Words behind the pyramid, which no dispatch may write."""

NEAREST = Sampler(mag="nearest", min="nearest", mipmap=None)


def sample_pipelines(kernels: Any, describe: Any, file: Path, shape: Sequence[int]) -> list[Any]:
    """Return the pipelines that draw depth of `shape` (H, W, samples), one for each sample.

    `describe` is the chapter's `PipelineDescription`; the shader is written to `file`.
    """
    file.write_text(SAMPLE, "utf-8")
    _, width, samples = shape
    described = [
        describe(
            ("post/fullscreen.vert", str(file)),
            (("WIDTH", width), ("SAMPLES", samples), ("NUMBER", number)),
            color="r32f",
            depth=None,
            samples=samples,
        )
        for number in range(samples)
    ]
    pipelines: list[Any] = kernels.pipelines.get(described)
    return pipelines


@contextmanager
def depth_on(
    kernels: Any, depth: np.ndarray, format: str = "r32f", samples: Sequence[Any] = ()
) -> Iterator[Any]:
    """Yield `depth` (H, W) as a texture of `format`, whose `run(layout, pipeline)` returns the pyramid's buffer.

    Depth of several samples (H, W, S) is drawn, by the pipelines `samples`.
    """
    kind = _GlDepth if isinstance(kernels, GlKernels) else _VulkanDepth
    with ExitStack() as stack:
        yield kind(kernels, stack, np.ascontiguousarray(depth, np.float32), format, samples)


def pyramid_of(kernels: Any, depth: np.ndarray, layout: Any, pipeline: Any, **more: Any) -> list[np.ndarray]:
    """Return the levels that the dispatches of `layout` make of `depth`, each as (height, width) float32."""
    with depth_on(kernels, depth, **more) as texture:
        words: np.ndarray = texture.run(layout, pipeline)
    assert (words[layout.words :] == POISON).all(), "a dispatch wrote behind the pyramid"
    return [
        words[level.first : level.first + level.width * level.height].reshape(level.height, level.width)
        for level in layout.levels
    ]


def _dispatch(commands: Any, layout: Any, pipeline: Any, bind: Callable[[], None]) -> None:
    """Run the dispatches, each after the writes of the one before."""
    for number, reduction in enumerate(layout.reductions):
        if number:
            commands.compute_barrier()
        commands.bind_compute(pipeline)
        bind()
        commands.push(pipeline, layout.constants(reduction))
        commands.dispatch(*reduction.groups)


class _VulkanDepth:
    """A depth image on Vulkan."""

    def __init__(
        self, kernels: Any, stack: ExitStack, depth: np.ndarray, format: str, samples: Sequence[Any]
    ) -> None:
        self.kernels, self._stack, device = kernels, stack, kernels.device
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT
        usage |= vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT if samples else vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        size = (depth.shape[1], depth.shape[0])
        self._image = create_image(device, format, size, usage, "depth", samples=max(1, len(samples)))
        stack.callback(destroy_image, device, self._image)
        self._sampler = create_sampler(device, NEAREST, 1.0, "depth")
        stack.callback(device.destroy, "VkSampler", self._sampler)
        if samples:
            self._draw(depth, samples)
            return
        with Uploader(device) as uploader:
            uploader.image(self._image, depth[..., None])

    def _draw(self, depth: np.ndarray, samples: Sequence[Any]) -> None:
        kernels, device, image = self.kernels, self.kernels.device, self._image
        values = self._buffer(depth.reshape(-1))
        sets = kernels.descriptors.create([(one.sets[0], {0: values}, "values") for one in samples])
        attachment = {
            "imageView": image.view,
            "imageLayout": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
        }
        area = {"extent": {"width": image.width, "height": image.height}}
        info = vk.new("VkRenderingInfo", renderArea=area, layerCount=1, pColorAttachments=[attachment])
        with submit_once(device) as handle:
            transition(device, handle, image, "undefined", "color")
            kernels.commands.begin(SimpleNamespace(commands=handle))
            device.fn.vkCmdBeginRendering(handle, info)
            kernels.commands.set_area((image.width, image.height))
            for pipeline, one in zip(samples, sets.handles, strict=True):
                kernels.commands.bind_pipeline(pipeline)
                kernels.commands.bind_set(pipeline, 0, vk.array("VkDescriptorSet", [one]))
                kernels.commands.draw_triangle()
            kernels.commands.end_rendering()
            transition(device, handle, image, "color", "sampled")
        kernels.descriptors.destroy(sets)

    def _buffer(self, values: np.ndarray) -> Any:
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffer = create_buffer(self.kernels.device, values.nbytes, usage, "upload", "values")
        self._stack.callback(destroy_buffer, self.kernels.device, buffer)
        buffer.view(np.float32)[: values.size] = values
        return buffer

    def run(self, layout: Any, pipeline: Any) -> np.ndarray:
        """Return the buffer that the dispatches of `layout` fill, with the words behind it."""
        kernels, device = self.kernels, self.kernels.device
        words = np.full(layout.words + SPARE, POISON, np.float32)
        buffer = self._buffer(words)
        textures = import_module(type(kernels.descriptors).__module__)
        held = {0: textures.Texture(self._image.view, self._sampler), 1: buffer}
        sets = kernels.descriptors.create([(pipeline.sets[0], held, "pyramid")])
        one = vk.array("VkDescriptorSet", [sets.handles[0]])
        with submit_once(device) as handle:
            kernels.commands.begin(SimpleNamespace(commands=handle))
            _dispatch(
                kernels.commands,
                layout,
                pipeline,
                lambda: kernels.commands.bind_compute_set(pipeline, 0, one),
            )
            device.fn.vkCmdPipelineBarrier2(handle, barriers(memory=TO_HOST))
        kernels.descriptors.destroy(sets)
        device.memory.invalidate(buffer.allocation)
        return buffer.view(np.float32)[: words.size].copy()


class _GlDepth:
    """A depth image on OpenGL."""

    def __init__(
        self, kernels: Any, stack: ExitStack, depth: np.ndarray, format: str, samples: Sequence[Any]
    ) -> None:
        self.kernels, self._stack, context = kernels, stack, kernels.context
        size = (depth.shape[1], depth.shape[0])
        self._image = gl_resources.create_image(context, format, size, "depth", samples=max(1, len(samples)))
        stack.callback(gl_resources.destroy_image, context, self._image)
        if samples:
            self._draw(depth, samples)
            return
        gl_resources.write_image(context, self._image, depth)

    def _draw(self, depth: np.ndarray, samples: Sequence[Any]) -> None:
        kernels, context = self.kernels, self.kernels.context
        values = self._buffer(depth.reshape(-1))
        target = gl_targets.create_framebuffer(context, [self._image], None, "depth")
        gl_targets.begin(context, target, [(0.0,) * 4])
        gl_resources.bind_buffer(context, "storage", 0, values)
        kernels.commands.begin(SimpleNamespace())
        for pipeline in samples:
            kernels.commands.draw_fullscreen(pipeline)
        gl_targets.destroy_framebuffer(context, target)

    def _buffer(self, values: np.ndarray) -> Any:
        context = self.kernels.context
        buffer = gl_resources.create_buffer(context, values.nbytes, "device", "values")
        self._stack.callback(gl_resources.destroy_buffer, context, buffer)
        gl_resources.write_buffer(context, buffer, values)
        return buffer

    def run(self, layout: Any, pipeline: Any) -> np.ndarray:
        """Return the buffer that the dispatches of `layout` fill, with the words behind it."""
        kernels, context = self.kernels, self.kernels.context
        words = np.full(layout.words + SPARE, POISON, np.float32)
        buffer = self._buffer(words)
        gl_resources.bind_buffer(context, "storage", 0, buffer)
        kernels.commands.begin(SimpleNamespace())
        _dispatch(
            kernels.commands,
            layout,
            pipeline,
            lambda: gl_resources.bind_texture(context, 0, self._image.view, 0),
        )
        context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found: np.ndarray = gl_resources.read_buffer(context, buffer, np.float32)[: words.size].copy()
        return found
