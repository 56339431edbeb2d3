"""The workbench of the self-tests: buffers, textures, one dispatch, one draw; all freed at its end.

It has the calls of `backends.vulkan.selftests.bench`, as far as OpenGL has what they are about. A list of resources is
bound in its order, storage buffers and textures each from binding 0 on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.draws import create_vertex_array
from backends.gl.programs import Program, Programs
from backends.gl.queries import Statistics
from backends.gl.readback import read_image
from backends.gl.resources import (
    Buffer,
    Image,
    bind_buffer,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    read_buffer,
    write_buffer,
)
from backends.gl.targets import begin, create_framebuffer, destroy_framebuffer
from backends.gl.upload import Uploader
from backends.selftest.data import SIZE, UNSET, Computation
from backends.shader_text import build_text
from common.scene import Sampler

NEAREST = Sampler("nearest", "nearest", None, "clamp", "clamp")
MIPMAPPED = Sampler("nearest", "nearest", "linear", "clamp", "clamp")


@dataclass(frozen=True)
class Texture:
    """An image and how it is sampled."""

    image: Image
    sampler: int


Resource = Buffer | Texture


class Session:
    """The context with all that its driver advertises, for the benches of a process; there is no device but number 0.

    Every call is checked, so that one that the driver refuses is not taken for a wrong result.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self._open = ExitStack()

    def __enter__(self) -> Session:
        self._context = self._open.enter_context(Context(validate=True, believe=True))
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def bench(self) -> Bench:
        """Return an empty bench."""
        return Bench(self._context)


class Bench:
    """Makes what a self-test needs in `context`, and frees it."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.fn = context.fn
        self._programs = Programs(context)
        self._free: list[Callable[[], None]] = [self._programs.close]

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.wait_idle()
        for free in reversed(self._free):
            free()

    def at_end(self, free: Callable[..., None], *arguments: Any) -> None:
        """Call `free(*arguments)` at the end, last given first."""
        self._free.append(lambda: free(*arguments))

    # --- buffers and textures ---

    def input(self, data: np.ndarray) -> Buffer:
        """Return a buffer with `data`, for storage, indices or indirect arguments."""
        buffer = create_buffer(self.context, data.nbytes, "device", "input")
        self.at_end(destroy_buffer, self.context, buffer)
        write_buffer(self.context, buffer, data)
        return buffer

    def output(self, words: int) -> Buffer:
        """Return a buffer of `words` 32-bit words, each UNSET, for `read`."""
        return self.input(np.full(words, UNSET, np.uint32))

    def read(self, buffer: Buffer, dtype: Any) -> np.ndarray:
        """Return a copy of what the GPU wrote to an output."""
        self.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return read_buffer(self.context, buffer, dtype)

    def texture(
        self,
        format: str,
        size: tuple[int, int],
        levels: Sequence[np.ndarray],
        how: Sampler,
        anisotropy: float = 1.0,
    ) -> Texture:
        """Return a 2D texture, (width, height), of mip levels: (rows, ...) arrays of texels, or of blocks."""
        image = create_image(self.context, format, size, "selftest", levels=len(levels))
        self.at_end(destroy_image, self.context, image)
        with Uploader(self.context) as uploader:
            uploader.chain(image, [[rows.reshape(len(rows), -1).view(np.uint8) for rows in levels]])
        sampler = create_sampler(self.context, how, anisotropy, "selftest")
        self.at_end(self.context.destroy, "sampler", sampler)
        return Texture(image, sampler)

    def ratio(self, wanted: float) -> float:
        """Return the anisotropy of a sampler for which `wanted` was asked."""
        out = gl.ffi.new("GLfloat[1]")
        self.fn.glGetFloatv(gl.GL_MAX_TEXTURE_MAX_ANISOTROPY, out)
        return min(wanted, float(out[0]))

    def statistics(self) -> Statistics:
        """Return counts of the GPU's work."""
        statistics = Statistics(self.context, "selftest")
        self.at_end(statistics.close)
        return statistics

    # --- programs ---

    def dispatch(
        self, source: str, resources: Sequence[Resource], groups: int = 1, extensions: Sequence[str] = ()
    ) -> None:
        """Run a compute shader once."""
        text = build_text(source, "comp", "gl", name="comp", extensions=extensions)
        self._bind(self._programs.get([text]), resources)
        self.fn.glDispatchCompute(groups, 1, 1)

    def computes(self, work: Computation, extensions: Sequence[str] = ()) -> str:
        """Return what is wrong with the results of `work`, or ""."""
        output = self.output(work.words)
        self.dispatch(work.source, [self.input(work.input), output], work.groups, extensions)
        return work.wrong(self.read(output, work.expected.dtype))

    def graphics(self, vertex: str, fragment: str) -> Program:
        """Return a program that draws triangles."""
        sources = {"vert": vertex, "frag": fragment}
        return self._programs.get(
            [build_text(text, stage, "gl", name=stage) for stage, text in sources.items()]
        )

    def render(
        self,
        program: Program,
        record: Callable[[], object],
        resources: Sequence[Resource] = (),
        indices: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return (16, 16) uint32: 0, and what `record()` draws, row 0 as in Vulkan; indices are 32 bits wide."""
        context, fn = self.context, self.fn
        image = create_image(context, "r32ui", SIZE, "selftest")
        self.at_end(destroy_image, context, image)
        target = create_framebuffer(context, [image], None, "selftest")
        self.at_end(destroy_framebuffer, context, target)
        listed = None if indices is None else self.input(indices)
        vertices = create_vertex_array(context, (), None, listed, "selftest")
        self.at_end(context.destroy, "vertex array", vertices)
        begin(context, target, [(0, 0, 0, 0)])
        fn.glBindVertexArray(vertices)
        self._bind(program, resources)
        record()
        return read_image(context, image)

    def _bind(self, program: Program, resources: Sequence[Resource]) -> None:
        buffers = [resource for resource in resources if isinstance(resource, Buffer)]
        textures = [resource for resource in resources if isinstance(resource, Texture)]
        for binding, buffer in enumerate(buffers):
            bind_buffer(self.context, "storage", binding, buffer)
        for unit, texture in enumerate(textures):
            bind_texture(self.context, unit, texture.image.view, texture.sampler)
        self.fn.glUseProgram(program.handle)
