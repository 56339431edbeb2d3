"""Compute pipelines on OpenGL: a program of one shader; compare vulkan_compute.py."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.programs import Program


def group_of(context: Context, program: Program) -> tuple[int, int, int]:
    """Return the invocations of a work group along each axis, of a compute program."""
    out = gl.ffi.new("GLint[3]")
    context.fn.glGetProgramiv(program.handle, gl.GL_COMPUTE_WORK_GROUP_SIZE, out)
    return int(out[0]), int(out[1]), int(out[2])
