"""The study torus-knot on Vulkan: vertices from a kernel, in the buffer that the vertex shader reads."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import (
    KERNEL,
    SHADERS,
    STUDY,
    UNIFORM_BYTES,
    VERTEX_BYTES,
    KernelWork,
    Settings,
    check,
    coefficient,
    matrices,
    push,
)
from .knot import indices

WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
DRAWN = (vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT)


class Renderer(Stage):
    """A knot that becomes another one."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Make the mesh, still empty, its triangles, and both pipelines."""
        check(self.settings)
        along, around = self.settings.along, self.settings.around
        self._vertices = self.empty(along * around * VERTEX_BYTES, ["storage"], "vertices")
        triangles = indices(along, around)
        self._indices, self._count = self.filled(triangles, ["index"], "triangles"), triangles.size
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "matrices")
        self._kernel, self._knot = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, color="rgba8", depth="write", name="knot"),
            ]
        )
        self._computing = self.set_of(self._kernel, {0: self._vertices}, "mesh of the kernel")
        self._drawing = [
            self.set_of(self._knot, {0: self._vertices, 1: uniforms}, f"mesh and {uniforms.name}")
            for uniforms in self._uniforms
        ]
        self._before = barriers(memory=(*DRAWN, *WRITTEN))  # the kernel waits for earlier reads
        self._behind = barriers(memory=(*WRITTEN, *DRAWN))  # the draw sees the writes
        self._made_with: float | None = None

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Compute the vertices if the shape has changed, and draw."""
        self.work = work = KernelWork(draws=1, triangles=self._count // 3)
        morph = coefficient(self.settings, time)
        if morph != self._made_with:
            commands.barrier(self._before)
            commands.begin_label("kernel")
            commands.bind_compute(self._kernel)
            commands.bind_compute_set(self._kernel, 0, self._computing)
            commands.push(self._kernel, push(self.settings, morph))
            commands.dispatch_over(self._kernel, (self.settings.along, self.settings.around))
            commands.end_label()
            commands.barrier(self._behind)
            self._made_with, work.dispatches = morph, 1
        slot, aspect = commands.slot.index, self.size[0] / self.size[1]
        self._uniforms[slot].view(np.float32)[:] = matrices(view, time, aspect).ravel()
        commands.begin_label("knot")
        self.begin(commands)
        commands.bind_pipeline(self._knot, cull=True)
        commands.bind_set(self._knot, 0, self._drawing[slot])
        fn = self.device.fn
        fn.vkCmdBindIndexBuffer(commands.handle, self._indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        fn.vkCmdDrawIndexed(commands.handle, self._count, 1, 0, 0, 0)
        self.end(commands)
        commands.end_label()

    def mesh(self) -> np.ndarray:
        """Return the vertices after the last frame, (along, around, 8) float32: position, u, normal, v."""
        vertices = self.download(self._vertices, WRITTEN).view(np.float32)
        return vertices.reshape(self.settings.along, self.settings.around, 8)

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        self._made_with = None  # another kernel makes another mesh
        return super()._exchange(changed)
