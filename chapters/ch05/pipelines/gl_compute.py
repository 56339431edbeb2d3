"""Compute pipelines on OpenGL: a program of one shader; compare vulkan_compute.py."""

from __future__ import annotations

from dataclasses import dataclass

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.programs import Program


@dataclass(frozen=True)
class ComputePipeline:
    """What a compute pipeline is made of. What OpenGL cannot specialize is a define of both backends."""

    shader: str
    defines: tuple[tuple[str, int | float | str], ...] = ()
    name: str = ""

    @property
    def shaders(self) -> tuple[str, ...]:
        """The files of all stages."""
        return (self.shader,)


def group_of(context: Context, program: Program) -> tuple[int, int, int]:
    """Return the invocations of a work group of a program that computes, along each axis."""
    out = gl.ffi.new("GLint[3]")
    context.fn.glGetProgramiv(program.handle, gl.GL_COMPUTE_WORK_GROUP_SIZE, out)
    return int(out[0]), int(out[1]), int(out[2])
