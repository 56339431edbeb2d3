"""Compute pipelines on OpenGL: a program of one shader; compare vulkan_compute.py."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.driver.capabilities import extensions, integer
from backends.gl.programs import Program

_SUBGROUP_SIZE = 0x9532  # GL_SUBGROUP_SIZE_KHR, of an extension that the binding does not have


def group_of(context: Context, program: Program) -> tuple[int, int, int]:
    """Return the invocations of a work group along each axis, of a compute program."""
    out = gl.ffi.new("GLint[3]")
    context.fn.glGetProgramiv(program.handle, gl.GL_COMPUTE_WORK_GROUP_SIZE, out)
    return int(out[0]), int(out[1]), int(out[2])


def subgroup_sizes(context: Context) -> tuple[int, ...]:
    """Return how many invocations of the device run together, or nothing: OpenGL tells it by an extension alone."""
    if "GL_KHR_shader_subgroup" not in extensions(context.fn):
        return ()
    return (integer(context.fn, _SUBGROUP_SIZE),)
