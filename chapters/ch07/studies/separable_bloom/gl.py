"""The study separable-bloom on OpenGL; compare vulkan.py."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import FOLDER, KERNELS, SHADERS, SIDE, STUDY, Settings, defines, order, picture, work_of


class Renderer(Stage):
    """A bright pass, blurs, and a triangle that shows them."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    light = staticmethod(picture)  # a fork may replace it

    def create(self) -> None:
        """Upload the picture, and make the kernels."""
        settings = self.settings
        self.source = self.filled(self.light().reshape(-1), "picture")
        self.bloom, self.across = (self.empty(16 * SIDE * SIDE, name) for name in ("bloom", "across"))
        wanted = [
            ComputeDescription(f"{FOLDER}/{file}", defines(settings, axis), name=name)
            for name, (file, axis) in KERNELS.items()
        ]
        shown = PipelineDescription(SHADERS, defines(settings), depth=None, name="show")
        *kernels, self._show = self.pipelines.get([*wanted, shown])
        self._kernels = dict(zip(KERNELS, kernels, strict=True))
        self._used = {
            "bright": (self.source, self.bloom),
            "across": (self.bloom, self.across),
            "down": (self.across, self.bloom),
            "show": (self.source, self.bloom),
        }

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Blur and show; a barrier stands before each use of what a kernel stored, and before the first store."""
        fn, self.work = self.device.fn, work_of(self.settings)
        for name in order(self.settings):
            self._bind(name)
            fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
            self.dispatch_over(self._kernels[name], (SIDE, SIDE))
        fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT)
        self.begin()
        self._bind("show")
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def _bind(self, name: str) -> None:
        for number, buffer in enumerate(self._used[name]):
            bind_buffer(self.device, "storage", number, buffer)

    def blurred(self) -> np.ndarray:
        """Return the bloom of the last frame, (SIDE, SIDE, 3) float32."""
        return self.download(self.bloom).view(np.float32).reshape(SIDE, SIDE, 4)[..., :3]
