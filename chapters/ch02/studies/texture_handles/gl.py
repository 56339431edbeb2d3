"""The study texture-handles on OpenGL: twelve textures by one call with their handles, or by twelve with one unit."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.draws import create_vertex_array
from backends.gl.driver.capabilities import extensions
from backends.gl.resources import bind_buffer, bind_texture
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ...scene.draw_lists import COMMAND
from ..stage_gl import Stage
from . import COUNT, EXTENSION, INDICES, SHADERS, SMOOTH, STUDY, Settings, defines, textures


class Renderer(Stage):
    """A grid of textures of different sizes."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload the textures and a command for each draw; ask for handles, and keep their textures within reach."""
        if self.settings.way == "handles" and EXTENSION not in extensions(self.device.fn):
            raise UnsupportedError(
                f"The study texture-handles needs the OpenGL extension {EXTENSION}, which the driver of "
                f"{self.capabilities.device} lacks: use another driver, or see the same picture with --set way=units."
            )
        self._smooth = self.sampler(SMOOTH, "texels")
        self._images = [self.texture(pixels, "2d", f"texture {n}") for n, pixels in enumerate(textures())]
        commands = np.zeros(COUNT, COMMAND)
        commands["index_count"], commands["instance_count"] = len(INDICES), 1
        commands["first_instance"] = np.arange(COUNT)
        self._commands = self.filled(commands, "draws")
        indices = self.filled(INDICES, "indices")
        vertex_array = create_vertex_array(self.device, (), None, indices, "rectangle")
        self._array = self.keep(vertex_array, lambda handle: self.device.destroy("vertex array", handle))
        described = PipelineDescription(SHADERS, defines(self.settings), depth=None, name=STUDY.title)
        self._pipeline = self.pipelines.get([described])[0]
        if self.settings.way == "handles":
            self.handles = np.array([self._handle(image.view) for image in self._images])
            self._handles = self.filled(self.handles, "handles")

    def _handle(self, texture: int) -> np.uint64:
        """Return the handle of a texture with its sampler: both can be read from here on, and changed no more."""
        fn = self.device.fn
        handle = fn.glGetTextureSamplerHandleARB(texture, self._smooth)
        # The driver does not know which textures a draw uses, as it does with texture units. So each texture that may
        # be used must be made resident. A handle that is not resident gives black, or undefined results.
        fn.glMakeTextureHandleResidentARB(handle)
        self.keep(handle, fn.glMakeTextureHandleNonResidentARB)
        return np.uint64(handle)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Draw all rectangles: by one call, or by one for each texture that has to be bound in between."""
        fn = self.device.fn
        self.begin()
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        fn.glBindVertexArray(self._array)
        fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, self._commands.handle)
        several = self.settings.way == "handles"
        if several:
            bind_buffer(self.device, "storage", 0, self._handles)
        calls = 1 if several else COUNT
        for call in range(calls):
            if not several:
                bind_texture(self.device, 0, self._images[call].view, self._smooth)
            first = gl.ffi.cast("void *", call * COMMAND.itemsize)
            fn.glMultiDrawElementsIndirect(
                gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT, first, COUNT // calls, COMMAND.itemsize
            )
        self.work.draws, self.work.triangles = COUNT, 2 * COUNT
