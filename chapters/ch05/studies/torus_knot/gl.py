"""The study torus-knot on OpenGL: vertices from a kernel, in the buffer that the vertex shader reads."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from backends.gl import api as gl
from backends.gl.draws import create_vertex_array
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
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


class Renderer(Stage):
    """A knot that becomes another one."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Make the mesh, still empty, its triangles, and both programs."""
        check(self.settings)
        along, around = self.settings.along, self.settings.around
        self._vertices = self.empty(along * around * VERTEX_BYTES, "vertices")
        triangles = indices(along, around)
        self._indices, self._count = self.filled(triangles, "triangles"), triangles.size
        array = create_vertex_array(self.device, (), None, self._indices, "triangles")
        self._array = self.keep(array, lambda resource: self.device.destroy("vertex array", resource))
        self._uniforms = self.per_slot(UNIFORM_BYTES, "matrices")
        self._kernel, self._knot = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, depth="write", name="knot"),
            ]
        )
        self._made_with: float | None = None

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Compute the vertices if the shape has changed, and draw."""
        fn = self.device.fn
        self.work = work = KernelWork(draws=1, triangles=self._count // 3)
        morph = coefficient(self.settings, time)
        bind_buffer(self.device, "storage", 0, self._vertices)
        if morph != self._made_with:
            # One kind of barrier on both sides: stores to buffers wait for earlier reads, and later reads see the
            # stores.
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self.dispatch_over(
                self._kernel, (self.settings.along, self.settings.around), push(self.settings, morph)
            )
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self._made_with, work.dispatches = morph, 1
        uniforms = self._uniforms[slot.index]
        uniforms.view(np.float32)[:] = matrices(view, time, self.size[0] / self.size[1]).ravel()
        self.begin()
        self.pipelines.bind(self._knot, cull=True, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, uniforms)
        fn.glBindVertexArray(self._array)
        fn.glDrawElementsBaseVertex(gl.GL_TRIANGLES, self._count, gl.GL_UNSIGNED_INT, gl.NULL, 0)

    def mesh(self) -> np.ndarray:
        """Return the vertices after the last frame, (along, around, 8) float32: position, u, normal, v."""
        vertices = self.download(self._vertices).view(np.float32)
        return vertices.reshape(self.settings.along, self.settings.around, 8)

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        self._made_with = None  # another kernel makes another mesh
        return super()._exchange(changed)
