"""Studies that fill the picture, on OpenGL: one triangle, uniforms for each frame in flight, perhaps a panorama."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import (
    Buffer,
    bind_buffer,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    write_image,
)
from common.view.camera import View

from ..frames.frame import SLOTS
from ..frames.gl import FrameSlot
from ..pipelines.description import PipelineDescription
from .full_screen import AROUND, texels
from .full_screen import FullScreen as AnyFullScreen
from .stage_gl import Stage


class FullScreen(AnyFullScreen, Stage):
    """A picture that is all fragment shader."""

    moves = False

    def create(self) -> None:
        """Make buffers, panorama and the program."""
        self._uniforms: list[Buffer] = []
        for slot in range(SLOTS):
            name = f"uniforms, slot {slot}"
            self._uniforms.append(create_buffer(self.device, self.uniform_bytes, "upload", name))
        panorama = self.panorama()
        if panorama is not None:
            pixels = texels(panorama)
            size = pixels.shape[1], pixels.shape[0]
            self._image = create_image(self.device, "rgba32f", size, panorama.name)
            write_image(self.device, self._image, pixels)
            self._sampler = create_sampler(self.device, AROUND, 1.0, panorama.name)
        described = PipelineDescription(
            shaders=("post/fullscreen.vert", f"studies/{self.fragment}"), depth=None, name=self.study.title
        )
        self._pipeline = self.pipelines.get([described])[0]

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write this frame's uniforms and fill the picture."""
        self._uniforms[slot.index].view(np.float32)[:] = self.uniforms(view, time)
        self.begin()
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, self._uniforms[slot.index])
        if hasattr(self, "_image"):
            bind_texture(self.device, 0, self._image.view, self._sampler)
        self.device.fn.glBindVertexArray(self.no_vertices)
        self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work.draws, self.work.triangles = 1, 1

    def destroy(self) -> None:
        """Free buffers, image and sampler."""
        for buffer in getattr(self, "_uniforms", ()):
            destroy_buffer(self.device, buffer)
        if hasattr(self, "_image"):
            destroy_image(self.device, self._image)
        if hasattr(self, "_sampler"):
            self.device.destroy("sampler", self._sampler)
