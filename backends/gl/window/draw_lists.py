"""Draws the lists of a user interface over a finished picture on OpenGL, with the same pixels as on Vulkan.

A window's own framebuffer counts its rows from the bottom. To draw there would turn every triangle upside down, and an
edge that meets the centres of pixels would then take the other row. So a list is drawn over a copy of the picture, rows
from the top as everywhere, and the copy goes to the window by the one blit that turns pictures (`present`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends import shader_text
from backends.gl import api as gl
from backends.gl import targets
from backends.gl.context import Context
from backends.gl.programs import Program, Programs
from backends.gl.resources import (
    FORMATS,
    Buffer,
    Image,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    write_buffer,
)
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer
from common.paths import ROOT
from common.scene import Sampler
from common.view.draw_lists import GREY, VERTEX, DrawList, TextureUpdate

SHADERS = (ROOT / "shaders" / "draw_list.vert", ROOT / "shaders" / "draw_list.frag")

SAMPLER = Sampler("linear", "linear", None, "clamp", "clamp")

_ATTRIBUTES = {
    "position": (2, gl.GL_FLOAT, 0),
    "uv": (2, gl.GL_FLOAT, 0),
    "color": (4, gl.GL_UNSIGNED_BYTE, 1),
}
"""Components, their type, and whether they are fractions of it."""


@dataclass
class _Copy:
    """The picture with the list over it, in the window's size."""

    image: Image
    framebuffer: Framebuffer


class DrawLists:
    """A program, textures by number, and the vertices of one list."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._textures: dict[int, Image] = {}
        self._vertices: Buffer | None = None
        self._indices: Buffer | None = None
        self._copy: _Copy | None = None
        self._programs = Programs(context)
        self._program: Program = self._programs.get(
            [shader_text.build(path, "gl") for path in SHADERS], "user interface"
        )
        self._sampler = create_sampler(context, SAMPLER, 1.0, "user interface")
        self._array = context.create("vertex array", "user interface")
        fn = context.fn
        for location, name in enumerate(VERTEX.names or ()):
            components, kind, fraction = _ATTRIBUTES[name]
            offset = VERTEX.fields[name][1] if VERTEX.fields is not None else 0
            fn.glEnableVertexArrayAttrib(self._array, location)
            fn.glVertexArrayAttribFormat(self._array, location, components, kind, fraction, offset)
            fn.glVertexArrayAttribBinding(self._array, location, 0)

    # --- textures ---

    def update(self, drawn: DrawList) -> None:
        """Take over the textures that a list brings and drop those that it gives up; each list once, drawn or not."""
        for update in drawn.updates:
            self.update_texture(update)
        for number in drawn.dropped:
            self._drop(number)

    def update_texture(self, update: TextureUpdate) -> None:
        """Copy pixels into a texture; one that is new or has another size must be given whole (ValueError)."""
        image = self._textures.get(update.texture)
        if image is not None and (image.width, image.height) != update.size:
            self._drop(update.texture)
            image = None
        if image is None:
            if not update.whole:
                raise ValueError(f"texture {update.texture} is new and was given in part")
            name = f"user interface texture {update.texture}"
            image = self._textures[update.texture] = create_image(self._context, "rgba8", update.size, name)
        height, width = update.pixels.shape[:2]
        raw, described = np.ascontiguousarray(update.pixels), FORMATS["rgba8"]
        where = (described.pixels, described.component, gl.pointer(raw))
        self._context.fn.glTextureSubImage2D(image.handle, 0, update.x, update.y, width, height, *where)

    def _drop(self, number: int) -> None:
        image = self._textures.pop(number, None)
        if image is not None:
            destroy_image(self._context, image)

    # --- drawing ---

    def over(self, picture: Framebuffer, drawn: DrawList, size: tuple[int, int]) -> Framebuffer:
        """Return a picture of `size` to `present` in place of `picture`: that one, scaled if need be, under the list.

        It is valid until the next call.
        """
        context = self._context
        if self._copy is None or self._copy.framebuffer.size != size:
            self._drop_copy()
            image = create_image(context, "rgba8", size, "picture under the user interface")
            framebuffer = create_framebuffer(context, [image], None, "picture under the user interface")
            self._copy = _Copy(image, framebuffer)
        target = self._copy.framebuffer
        targets.copy(context, picture, target, linear=picture.size != size)
        self.draw(target, drawn)
        return target

    def draw(self, target: Framebuffer, drawn: DrawList) -> None:
        """Draw a list over what `target` holds. ValueError for a texture that no `update` brought.

        Blending, culling, the depth test and the scissor test are off afterwards, and `target` stays bound.
        """
        if not drawn.commands:
            return
        context, fn = self._context, self._context.fn
        self._vertices = self._fill(self._vertices, drawn.vertices, "vertices")
        self._indices = self._fill(self._indices, drawn.indices, "indices")
        targets.begin(context, target)
        fn.glVertexArrayVertexBuffer(self._array, 0, self._vertices.handle, 0, VERTEX.itemsize)
        fn.glVertexArrayElementBuffer(self._array, self._indices.handle)
        fn.glBindVertexArray(self._array)
        fn.glUseProgram(self._program.handle)
        fn.glDisable(gl.GL_DEPTH_TEST)
        fn.glDisable(gl.GL_CULL_FACE)
        fn.glEnable(gl.GL_BLEND)
        fn.glBlendEquationSeparate(gl.GL_FUNC_ADD, gl.GL_FUNC_ADD)
        over = gl.GL_ONE_MINUS_SRC_ALPHA
        fn.glBlendFuncSeparate(gl.GL_SRC_ALPHA, over, gl.GL_ONE, over)
        fn.glEnable(gl.GL_SCISSOR_TEST)
        push = np.zeros(8, np.uint32)
        push[:4] = drawn.transform().view(np.uint32)
        bound: int | None = None
        try:
            for command in drawn.commands:
                clip = drawn.scissor(command, target.size)
                if clip is None or not command.count:
                    continue
                if command.texture != bound:
                    bound = command.texture
                    image = self._textures.get(bound & ~GREY)
                    if image is None:
                        raise ValueError(
                            f"a user interface uses texture {bound & ~GREY}, which it never gave"
                        )
                    bind_texture(context, 0, image.view, self._sampler)
                    push[4] = int(bool(bound & GREY))
                    context.push(push)
                fn.glScissor(*clip)
                fn.glDrawElementsBaseVertex(
                    gl.GL_TRIANGLES,
                    command.count,
                    gl.GL_UNSIGNED_INT,
                    gl.ffi.cast("void *", 4 * command.first),
                    command.base,
                )
        finally:
            fn.glDisable(gl.GL_SCISSOR_TEST)
            fn.glDisable(gl.GL_BLEND)

    def _fill(self, buffer: Buffer | None, data: np.ndarray, name: str) -> Buffer:
        """Copy an array into a buffer, which grows by doubling, and return that; the driver keeps what is in use."""
        if buffer is None or buffer.size < data.nbytes:
            if buffer is not None:
                destroy_buffer(self._context, buffer)
            size = max(1 << 16, 1 << (data.nbytes - 1).bit_length())
            buffer = create_buffer(self._context, size, "device", f"user interface {name}")
        write_buffer(self._context, buffer, data)
        return buffer

    def _drop_copy(self) -> None:
        if self._copy is not None:
            destroy_framebuffer(self._context, self._copy.framebuffer)
            destroy_image(self._context, self._copy.image)
            self._copy = None

    def close(self) -> None:
        """Free everything."""
        context = self._context
        self._drop_copy()
        for number in list(self._textures):
            self._drop(number)
        for buffer in (self._vertices, self._indices):
            if buffer is not None:
                destroy_buffer(context, buffer)
        self._vertices = self._indices = None
        context.destroy("vertex array", self._array)
        context.destroy("sampler", self._sampler)
        self._programs.close()
