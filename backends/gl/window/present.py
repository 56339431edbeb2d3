"""The picture in a window: one blit, and the only place where OpenGL turns anything upside down.

Row 0 of a picture is its top, in memory and in files; a window's default framebuffer counts its rows from the bottom.
"""

from __future__ import annotations

from typing import Any

from backends.gl import api as gl
from backends.gl import targets
from backends.gl.context import Context, let_go
from backends.gl.targets import Framebuffer
from backends.window import Window


def open_window(size: tuple[int, int], title: str, **more: Any) -> Window:
    """Open a window for `Context(window=window.handle)`; `more` goes to `Window`. No context is current afterwards.

    Raises UnsupportedError where there is no display.
    """
    let_go()  # GLFW makes the window's context current for a moment: no other context may be current then
    return Window(size, title, "gl", hints=hints(), **more)


def hints() -> dict[int, int]:
    """Return GLFW's window hints for a context that Strata can use."""
    import glfw

    return {
        glfw.CLIENT_API: glfw.OPENGL_API,
        glfw.CONTEXT_VERSION_MAJOR: 4,
        glfw.CONTEXT_VERSION_MINOR: 5,
        glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
        glfw.OPENGL_FORWARD_COMPAT: 1,
        glfw.SAMPLES: 0,
        glfw.DEPTH_BITS: 0,  # nothing but finished pictures goes to the window
        glfw.STENCIL_BITS: 0,
    }


def present(context: Context, picture: Framebuffer, window: Any, size: tuple[int, int]) -> None:
    """Show the first colour attachment of `picture`, display codes in "rgba8", in a GLFW window of `size` pixels.

    It is scaled to the window where the sizes differ. A window of no pixels (minimised) gets nothing.
    """
    if 0 in size:
        return
    import glfw

    blit(context, picture, Framebuffer(0, size, (), None, "window"))
    glfw.swap_buffers(window)


def blit(context: Context, picture: Framebuffer, target: Framebuffer) -> None:
    """Copy a picture of display codes upside down into `target`, without changing the codes."""
    fn = context.fn
    fn.glDisable(
        gl.GL_FRAMEBUFFER_SRGB
    )  # the codes are finished; a window that is sRGB would code them again
    targets.copy(context, picture, target, flipped=True, linear=picture.size != target.size)
    fn.glEnable(gl.GL_FRAMEBUFFER_SRGB)
