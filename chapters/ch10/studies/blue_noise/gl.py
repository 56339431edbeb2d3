"""The study blue-noise on OpenGL: images, their transforms in two dispatches, and the picture."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.numerics.blue_noise import SIZE
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import (
    IMAGE_BYTES,
    IMAGES,
    KERNELS,
    KINDS,
    LINE_BYTES,
    POWER_BYTES,
    SHADERS,
    STUDY,
    WAYS,
    Settings,
    defines,
    extent,
    push,
    tables,
    told,
    turns,
    work,
)


class Renderer(Stage):
    """A ramp by white and blue noise, beside the spectra of its errors."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload tables, make room for images and spectra, and build the programs."""
        self._buffers = (
            self.filled(tables(), "tables"),
            self.empty(IMAGE_BYTES, "images"),
            self.filled(turns(), "turns"),
            self.empty(LINE_BYTES, "lines"),
            self.empty(POWER_BYTES, "powers"),
        )
        self._images, self._transform, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, defines(), name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, defines(), depth=None, name="show"),
            ]
        )

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Take samples, transform rows and columns of their errors, and show."""
        fn, knobs = self.device.fn, self.settings
        for binding, buffer in enumerate(self._buffers):
            bind_buffer(self.device, "storage", binding, buffer)
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.dispatch_over(self._images, (SIZE, SIZE, len(WAYS)), push(knobs))
        for columns in (False, True):
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self.dispatch_over(self._transform, extent(columns), push(knobs, columns))
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        self.device.push(np.array([*self.size, knobs.frames, knobs.steps], np.uint32))
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work = work()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return what the spectra of the last frame say, after a wait for it."""
        return told(self.spectra())

    def images(self) -> np.ndarray:
        """Return the images of the last frame, (WAYS, IMAGES, SIZE, SIZE) float32."""
        return self.download(self._buffers[1]).view(np.float32).reshape(len(WAYS), len(IMAGES), SIZE, SIZE)

    def spectra(self) -> np.ndarray:
        """Return the power of the errors of the last frame, (WAYS, KINDS, SIZE, SIZE) float32."""
        return self.download(self._buffers[4]).view(np.float32).reshape(len(WAYS), len(KINDS), SIZE, SIZE)
