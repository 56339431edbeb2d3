"""The study clear-window on OpenGL: one call. What the driver does for it is in vulkan.py."""

from __future__ import annotations

from backends.gl import api as gl
from common.view.camera import View

from ...frames.gl import FrameSlot
from ..stage_gl import Stage
from . import STUDY, color_at


class Renderer(Stage):
    """One colour. No barrier, no layout: the driver tracks the uses of an image, and waits where it must."""

    study = STUDY

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Clear the picture. The call names its target, so nothing has to be bound before."""
        fn = self.device.fn
        # A clear obeys the write mask that an earlier call has set. OpenGL is one large state that persists, so code
        # sets each part that it depends on.
        fn.glColorMask(1, 1, 1, 1)
        fn.glDisable(gl.GL_SCISSOR_TEST)
        color = gl.ffi.new("GLfloat[4]", color_at(time))
        fn.glClearNamedFramebufferfv(self.framebuffer.handle, gl.GL_COLOR, 0, color)
