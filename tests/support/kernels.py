"""Kernels of tests, run by a chapter's own compute pipelines over arrays, on either backend.

The chapter is given as the name of its package: that of the test that asks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl import resources as gl_resources
from backends.gl.context import Context
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import create_buffer, destroy_buffer


class VulkanKernels:
    """Runs kernels whose storage buffers are set 0, binding 0 and up."""

    def __init__(self, device: Any, package: str) -> None:
        self.device = device
        self.pipelines = import_module(f"{package}.pipelines.vulkan").Pipelines(device)
        self.descriptors = import_module(f"{package}.pipelines.vulkan_descriptors").Descriptors(device)
        self.commands = import_module(f"{package}.frames.vulkan_commands").Commands(device)
        self._describe = import_module(f"{package}.pipelines.compute_description").ComputeDescription

    def pipeline(self, file: Path, **more: Any) -> Any:
        return self.pipelines.get([self._describe(str(file), **more)])[0]

    def reload(self, file: Path) -> tuple[str, ...]:
        reloaded: tuple[str, ...] = self.pipelines.reload({file}, lambda free: free())
        return reloaded

    def run(
        self,
        pipelines: Any,
        arrays: Sequence[np.ndarray],
        extent: Sequence[int],
        push: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Dispatch over `extent`, pipeline after pipeline with a barrier between, and return the arrays afterwards."""
        pipelines = pipelines if isinstance(pipelines, list) else [pipelines]
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffers = [
            create_buffer(self.device, one.nbytes, usage, "upload", f"array {number}")
            for number, one in enumerate(arrays)
        ]
        for buffer, one in zip(buffers, arrays, strict=True):
            buffer.mapped[:] = one.view(np.uint8).reshape(-1)
        held = dict(enumerate(buffers))
        sets = self.descriptors.create([(one.sets[0], held, "arrays") for one in pipelines])
        commands = self.commands
        with submit_once(self.device) as handle:
            commands.begin(SimpleNamespace(commands=handle))
            for number, (one, a_set) in enumerate(zip(pipelines, sets.handles, strict=True)):
                if number:
                    commands.compute_barrier()
                commands.bind_compute(one)
                commands.bind_compute_set(one, 0, vk.array("VkDescriptorSet", [a_set]))
                if push is not None:
                    commands.push(one, push)
                commands.dispatch_over(one, extent)
            self.device.fn.vkCmdPipelineBarrier2(handle, barriers(memory=TO_HOST))
        found = []
        for buffer, one in zip(buffers, arrays, strict=True):
            self.device.memory.invalidate(buffer.allocation)
            found.append(buffer.view(one.dtype)[: one.size].reshape(one.shape).copy())
            destroy_buffer(self.device, buffer)
        self.descriptors.destroy(sets)
        return found

    def close(self) -> None:
        self.descriptors.close()
        self.pipelines.close()


class GlKernels:
    """Runs kernels whose storage buffers are bound from 0 on."""

    def __init__(self, context: Context, package: str) -> None:
        self.context = context
        self.pipelines = import_module(f"{package}.pipelines.gl").Pipelines(context)
        self.commands = import_module(f"{package}.frames.gl_commands").Commands(context, self.pipelines, True)
        self._describe = import_module(f"{package}.pipelines.compute_description").ComputeDescription

    def pipeline(self, file: Path, **more: Any) -> Any:
        return self.pipelines.get([self._describe(str(file), **more)])[0]

    def reload(self, file: Path) -> tuple[str, ...]:
        reloaded: tuple[str, ...] = self.pipelines.reload({file})
        return reloaded

    def run(
        self,
        pipelines: Any,
        arrays: Sequence[np.ndarray],
        extent: Sequence[int],
        push: np.ndarray | None = None,
    ) -> list[np.ndarray]:
        """Dispatch over `extent`, pipeline after pipeline with a barrier between, and return the arrays afterwards."""
        context, commands = self.context, self.commands
        buffers = [
            gl_resources.create_buffer(context, one.nbytes, "device", f"array {number}")
            for number, one in enumerate(arrays)
        ]
        for number, (buffer, one) in enumerate(zip(buffers, arrays, strict=True)):
            gl_resources.write_buffer(context, buffer, one)
            gl_resources.bind_buffer(context, "storage", number, buffer)
        commands.begin(SimpleNamespace())
        for number, one in enumerate(pipelines if isinstance(pipelines, list) else [pipelines]):
            if number:
                commands.compute_barrier()
            commands.bind_compute(one)
            if push is not None:
                commands.push(one, push)
            commands.dispatch_over(one, extent)
        context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found = []
        for buffer, one in zip(buffers, arrays, strict=True):
            found.append(
                gl_resources.read_buffer(context, buffer, one.dtype)[: one.size].reshape(one.shape).copy()
            )
            gl_resources.destroy_buffer(context, buffer)
        return found

    def close(self) -> None:
        self.pipelines.close()


@contextmanager
def kernels_on(device: Any, package: str) -> Iterator[Any]:
    """Yield what runs kernels on a Vulkan device or an OpenGL context; `package` is the chapter whose pipelines do."""
    made: Any = (GlKernels if isinstance(device, Context) else VulkanKernels)(device, package)
    try:
        yield made
    finally:
        made.close()
