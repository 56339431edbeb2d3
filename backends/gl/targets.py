"""Framebuffers: what is drawn to, cleared, resolved and copied.

They are made without being bound, from single levels and layers or from whole arrays and cubes (layered: `gl_Layer`
chooses). moderngl's own framebuffers take neither cubes nor layers nor levels, draw nothing at all to an attachment
that was added later, and hold depth in 24 bits; so it never sees these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import Image, level_size
from common.errors import DeviceError


@dataclass(frozen=True)
class Attachment:
    """A level of an image to draw to: one of its layers, or with None all of them (an image of one layer is plain)."""

    image: Image
    level: int = 0
    layer: int | None = None


@dataclass(eq=False)
class Framebuffer:
    """Attachments to draw to, with their common size. `handle` 0 is a window's."""

    handle: int
    size: tuple[int, int]
    colors: tuple[Attachment, ...]
    depth: Attachment | None
    name: str


def create_framebuffer(
    context: Context,
    colors: Sequence[Attachment | Image],
    depth: Attachment | Image | None,
    name: str,
) -> Framebuffer:
    """Return a framebuffer; raise DeviceError when the driver cannot draw to these attachments together."""
    held = tuple(_attachment(attachment) for attachment in colors)
    deep = None if depth is None else _attachment(depth)
    everything = [*held, *([deep] if deep else [])]
    if not everything:
        raise ValueError(f"'{name}' has no attachment.")
    sizes = {level_size(attachment.image, attachment.level) for attachment in everything}
    if len(sizes) > 1:
        raise ValueError(f"'{name}' has attachments of different sizes: {sorted(sizes)}.")
    samples = {attachment.image.samples for attachment in everything}
    if len(samples) > 1:
        # Some drivers take them (NV_framebuffer_mixed_samples), most do not.
        raise ValueError(f"'{name}' has attachments of different numbers of samples: {sorted(samples)}.")
    handle, fn = context.create("framebuffer", name), context.fn
    for number, attachment in enumerate(held):
        _attach(context, handle, gl.GL_COLOR_ATTACHMENT0 + number, attachment)
    if deep is not None:
        _attach(context, handle, gl.GL_DEPTH_ATTACHMENT, deep)
    buffers = gl.ffi.new("GLenum[]", [gl.GL_COLOR_ATTACHMENT0 + number for number in range(len(held))])
    fn.glNamedFramebufferDrawBuffers(handle, len(held), buffers)
    if not held:
        fn.glNamedFramebufferReadBuffer(handle, gl.GL_NONE)
    status = fn.glCheckNamedFramebufferStatus(handle, gl.GL_FRAMEBUFFER)
    if status != gl.GL_FRAMEBUFFER_COMPLETE:
        context.destroy("framebuffer", handle)
        formats = ", ".join(
            f"{attachment.image.name} ({attachment.image.storage_format})" for attachment in everything
        )
        raise DeviceError(f"The driver cannot draw to '{name}' ({status:#x}): {formats}.")
    return Framebuffer(handle, sizes.pop(), held, deep, name)


def _attachment(target: Attachment | Image) -> Attachment:
    return Attachment(target) if isinstance(target, Image) else target


def _attach(context: Context, framebuffer: int, point: int, target: Attachment) -> None:
    # The view, not the storage: an image viewed as sRGB is written as sRGB.
    if target.layer is None:
        context.fn.glNamedFramebufferTexture(framebuffer, point, target.image.view, target.level)
    else:
        context.fn.glNamedFramebufferTextureLayer(
            framebuffer, point, target.image.view, target.level, target.layer
        )


def destroy_framebuffer(context: Context, framebuffer: Framebuffer) -> None:
    """Free a framebuffer; its images live on."""
    context.destroy("framebuffer", framebuffer.handle)


def begin(
    context: Context,
    framebuffer: Framebuffer,
    clear_colors: Sequence[Sequence[float] | None] = (),
    clear_depth: float | None = None,
) -> None:
    """Draw to `framebuffer` from here on, over its whole size, after clearing what has a value (all its layers).

    Scissor and write masks are reset first, since OpenGL's clears respect them.
    """
    fn = context.fn
    fn.glBindFramebuffer(gl.GL_FRAMEBUFFER, framebuffer.handle)
    fn.glViewport(0, 0, *framebuffer.size)
    fn.glDisable(gl.GL_SCISSOR_TEST)
    fn.glColorMask(1, 1, 1, 1)
    fn.glDepthMask(1)
    for number, value in enumerate(clear_colors):
        if value is None:
            continue
        if framebuffer.colors[number].image.format.endswith("ui"):
            fn.glClearNamedFramebufferuiv(
                framebuffer.handle, gl.GL_COLOR, number, gl.ffi.new("GLuint[4]", [int(v) for v in value])
            )
        else:
            fn.glClearNamedFramebufferfv(
                framebuffer.handle, gl.GL_COLOR, number, gl.ffi.new("GLfloat[4]", list(value))
            )
    if clear_depth is not None:
        fn.glClearNamedFramebufferfv(
            framebuffer.handle, gl.GL_DEPTH, 0, gl.ffi.new("GLfloat[1]", [clear_depth])
        )


def copy(
    context: Context,
    source: Framebuffer,
    target: Framebuffer,
    *,
    depth: bool = False,
    color: int = 0,
    flipped: bool = False,
    linear: bool = False,
) -> None:
    """Copy one colour attachment of `source` (or the depth) to the first of `target`, scaled if the sizes differ.

    From several samples to one it resolves: the mean of each pixel's samples, for depth one of them. `flipped` turns
    the picture upside down.
    """
    fn = context.fn
    if not depth and source.handle:
        fn.glNamedFramebufferReadBuffer(source.handle, gl.GL_COLOR_ATTACHMENT0 + color)
    fn.glDisable(gl.GL_SCISSOR_TEST)
    (width, height), (to_width, to_height) = source.size, target.size
    rows = (to_height, 0) if flipped else (0, to_height)
    fn.glBlitNamedFramebuffer(
        source.handle,
        target.handle,
        *(0, 0, width, height),
        *(0, rows[0], to_width, rows[1]),
        gl.GL_DEPTH_BUFFER_BIT if depth else gl.GL_COLOR_BUFFER_BIT,
        gl.GL_LINEAR if linear and not depth else gl.GL_NEAREST,
    )
