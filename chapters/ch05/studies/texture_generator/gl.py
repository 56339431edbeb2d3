"""The study texture-generator on OpenGL: an image unit to write through, a texture unit to read through."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from backends.gl import api as gl
from backends.gl.resources import bind_storage_image, bind_texture, create_image, destroy_image
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import SHADERS, STUDY, TEXELS, KernelWork, Settings, kernel, push, texture_size


class Renderer(Stage):
    """A texture that a kernel writes, over the whole picture."""

    study = STUDY
    settings_class: type = Settings
    kernel = staticmethod(kernel)  # a fork may replace it

    def create(self) -> None:
        """Make both programs."""
        described = PipelineDescription(SHADERS, depth=None, name="show")
        self._kernel, self._show = self.pipelines.get(
            [ComputeDescription(self.kernel(self.settings), name=self.settings.shader), described]
        )
        self._sampler = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make the texture."""
        limit = self.capabilities.limits["maxImageDimension2D"]
        self.extent = texture_size(self.settings, self.size, limit)
        self._image = create_image(self.device, "rgba8", self.extent, "generated")
        self.keep_sized(self._image, lambda resource: destroy_image(self.device, resource))
        if "texture" in self.outputs:
            self._targets["texture"] = self._image
        self._made_at: float | None = None

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Compute the texture if the time has changed, and show it."""
        fn = self.device.fn
        self.work = work = KernelWork(draws=1, triangles=1)
        if time != self._made_at:
            # After a barrier of their own kind, stores also wait for earlier reads.
            fn.glMemoryBarrier(gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT)
            bind_storage_image(self.device, 0, self._image, access="write")
            self.dispatch_over(self._kernel, self.extent, push(time))
            fn.glMemoryBarrier(gl.GL_TEXTURE_FETCH_BARRIER_BIT)
            self._made_at, work.dispatches = time, 1
        self.begin()
        self.pipelines.bind(self._show, cull=False, front="counter_clockwise")
        bind_texture(self.device, 0, self._image.view, self._sampler)
        fn.glBindVertexArray(self.no_vertices)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        self._made_at = None  # another shader makes another texture
        return super()._exchange(changed)
