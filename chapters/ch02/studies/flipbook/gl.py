"""The study flipbook on OpenGL: an array texture of a hundred pictures, a list of instances, one draw."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import bind_buffer, bind_texture
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ..stage_gl import Stage
from . import (
    CAPACITY,
    RECORD,
    SHADERS,
    SMOOTH,
    STUDY,
    UNIFORM_BYTES,
    Settings,
    explosions,
    pictures,
    records_of,
)


class Renderer(Stage):
    """Explosions that began at different times, in different places."""

    study = STUDY
    settings_class: type = Settings
    explosions = staticmethod(explosions)  # yours may stand here
    pictures = staticmethod(pictures)

    def create(self) -> None:
        """Upload the book, and make what draws it."""
        self._book = self.texture(self.pictures(), "array", "book")
        self._smooth = self.sampler(SMOOTH, "book")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "picture's size")
        self._records = self.per_slot(CAPACITY * RECORD.itemsize, "explosions")
        described = PipelineDescription(SHADERS, depth=None, blend="over", name=STUDY.title)
        self._pipeline = self.pipelines.get([described])[0]

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write this frame's instances and draw all at once; when all have gone out there is no draw."""
        records = records_of(self.explosions(self.settings, self.size, time), self.settings, self.size, time)
        self.begin()
        if len(records):
            self._uniforms[slot.index].view(np.float32)[:2] = self.size
            self._records[slot.index].view(RECORD)[: len(records)] = records
            self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
            bind_buffer(self.device, "uniform", 0, self._uniforms[slot.index])
            bind_buffer(self.device, "storage", 1, self._records[slot.index])
            bind_texture(self.device, 0, self._book.view, self._smooth)
            self.device.fn.glBindVertexArray(self.no_vertices)
            self.device.fn.glDrawArraysInstanced(gl.GL_TRIANGLES, 0, 6, len(records))
        self.work.draws, self.work.triangles = int(len(records) > 0), 2 * len(records)
