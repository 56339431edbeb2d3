"""The study textured-quads on OpenGL: two textures, a list of quads in mapped memory, one draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, bind_texture, create_image, create_sampler, destroy_image
from backends.gl.upload import Uploader
from common.scene import Sampler
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..drawing_gl import Drawing
from . import (
    CAPACITY,
    DRAWN,
    RECORD,
    STUDY,
    UNIFORM_BYTES,
    Settings,
    depth_texels,
    picture_texels,
    quads_for,
    records_of,
    uniforms,
)


class Renderer(Drawing):
    """Rectangles of pixels that show textures."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    moves = False
    quads_for = staticmethod(quads_for)  # yours may stand here
    texels = staticmethod(lambda: (picture_texels(), depth_texels()))

    def create(self) -> None:
        """Upload both textures, and make what draws them."""
        self._images: list[Any] = []
        # "nearest": a texel is shown, never a mixture of two. "rgba8": codes go in and come out, nothing is decoded.
        self._sampler = create_sampler(
            self.device, Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0, ""
        )
        for format, pixels in zip(("rgba8", "r32f"), self.texels(), strict=True):
            size = pixels.shape[1], pixels.shape[0]
            self._images.append(create_image(self.device, format, size, f"shown {format}"))
            with Uploader(self.device) as uploader:
                uploader.image(self._images[-1], pixels)
        self._quads = self.per_slot(CAPACITY * RECORD.itemsize, "quads")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "sizes")
        self._program = self.build(DRAWN)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write this frame's quads and draw all at once; without quads there is no draw."""
        records = records_of(self.quads_for(self.size))
        self.begin()
        if len(records):
            quads, frame = self._quads[slot.index], self._uniforms[slot.index]
            quads.view(RECORD)[: len(records)] = records
            frame.view(np.float32)[:] = uniforms(self.settings, self.size)
            self.bind(self._program)
            bind_buffer(self.device, "uniform", 0, frame)
            bind_buffer(self.device, "storage", 1, quads)
            for unit, image in enumerate(self._images):
                bind_texture(self.device, unit, image.view, self._sampler)
            self.device.fn.glBindVertexArray(self.no_vertices)
            self.device.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 6 * len(records))
            self.unbind()
        self.work.draws, self.work.triangles = int(len(records) > 0), 2 * len(records)

    def destroy(self) -> None:
        """Free images and sampler, and the rest."""
        super().destroy()
        for image in getattr(self, "_images", ()):
            destroy_image(self.device, image)
        if hasattr(self, "_sampler"):
            self.device.destroy("sampler", self._sampler)
