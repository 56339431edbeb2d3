"""ARB_gl_spirv: the module that Vulkan runs, specialised by an OpenGL driver that takes SPIR-V, gives the same output.

The renderers give OpenGL text, since GL 4.5 promises no SPIR-V; so what this needs of raw calls stands here alone.
"""

from __future__ import annotations

import numpy as np
import pytest

from backends import shader_text
from backends.gl import api as gl
from backends.gl.driver.capabilities import extensions
from backends.gl.resources import bind_buffer, create_buffer, destroy_buffer, read_buffer, write_buffer
from backends.vulkan.shaders.compiler import compile_shader
from tests.support import gpu_functions as vulkan

COMPUTE_SHADER, SPIR_V, COMPILE_STATUS, LINK_STATUS = 0x91B9, 0x9551, 0x8B81, 0x8B82
CALLS = {
    "glCreateShader": "GLuint (*)(GLenum)",
    "glShaderBinary": "void (*)(GLsizei, const GLuint *, GLenum, const void *, GLsizei)",
    "glSpecializeShaderARB": "void (*)(GLuint, const GLchar *, GLuint, const GLuint *, const GLuint *)",
    "glGetShaderiv": "void (*)(GLuint, GLenum, GLint *)",
    "glCreateProgram": "GLuint (*)(void)",
    "glAttachShader": "void (*)(GLuint, GLuint)",
    "glLinkProgram": "void (*)(GLuint)",
    "glGetProgramiv": "void (*)(GLuint, GLenum, GLint *)",
    "glDeleteShader": "void (*)(GLuint)",
    "glDeleteProgram": "void (*)(GLuint)",
}
BODY = "    lit = srgb_from_linear(abs(x)) + vec3(uvec3(n * n));\n"
INPUTS = {"x": "vec3", "n": "uint"}


def state(call, name: int, what: int) -> int:
    found = gl.ffi.new("GLint *")
    call(name, what, found)
    return int(found[0])


@pytest.mark.feature("device/spirv-in-gl")
def test_one_module_gives_the_same_output_on_both_apis(vulkan_device, gl_context):
    if "GL_ARB_gl_spirv" not in extensions(gl_context.fn):
        pytest.skip("spirv-in-gl: the driver lacks GL_ARB_gl_spirv")
    rng = np.random.default_rng(0)
    inputs = {
        "x": rng.uniform(-1, 1, (500, 3)).astype(np.float32),
        "n": rng.integers(0, 9, 500, dtype=np.uint32),
    }
    truth = vulkan.evaluate(vulkan_device, ["srgb.glsl"], BODY, inputs, {"lit": "vec3"})["lit"]
    text = vulkan._shader(["srgb.glsl"], BODY, INPUTS, {"lit": "vec3"})
    code = compile_shader(shader_text.build_text(text, "comp", "vulkan"))

    calls = {name: gl.ffi.cast(kind, gl_context.fn._resolve(name)) for name, kind in CALLS.items()}
    shader, program = calls["glCreateShader"](COMPUTE_SHADER), calls["glCreateProgram"]()
    buffers = [create_buffer(gl_context, array.nbytes, "device", name) for name, array in inputs.items()]
    buffers.append(create_buffer(gl_context, truth.nbytes, "device", "lit"))
    try:
        calls["glShaderBinary"](1, gl.ffi.new("GLuint[1]", [shader]), SPIR_V, code, len(code))
        calls["glSpecializeShaderARB"](shader, b"main", 0, gl.NULL, gl.NULL)
        assert state(calls["glGetShaderiv"], shader, COMPILE_STATUS)
        calls["glAttachShader"](program, shader)
        calls["glLinkProgram"](program)
        assert state(calls["glGetProgramiv"], program, LINK_STATUS)
        for buffer, array in zip(buffers, inputs.values(), strict=False):
            write_buffer(gl_context, buffer, array)
        for number, buffer in enumerate(buffers):
            bind_buffer(gl_context, "storage", number, buffer)
        gl_context.fn.glUseProgram(program)
        gl_context.fn.glDispatchCompute((len(truth) + vulkan.GROUP - 1) // vulkan.GROUP, 1, 1)
        gl_context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found = read_buffer(gl_context, buffers[-1], np.dtype(np.float32)).reshape(truth.shape)
    finally:
        gl_context.fn.glUseProgram(0)
        calls["glDeleteProgram"](program)
        calls["glDeleteShader"](shader)
        for buffer in buffers:
            destroy_buffer(gl_context, buffer)
    assert truth.max() > 60  # it ran: the largest square is 64
    if vulkan_device.capabilities.is_software and gl_context.capabilities.is_software:
        assert np.array_equal(found, truth)
    else:
        assert np.allclose(found, truth, rtol=1e-5)


@pytest.mark.feature("device/spirv-in-gl")
def test_a_module_is_refused_where_it_has_no_such_function(gl_context):
    if "GL_ARB_gl_spirv" not in extensions(gl_context.fn):
        pytest.skip("spirv-in-gl: the driver lacks GL_ARB_gl_spirv")
    code = compile_shader(
        shader_text.build_text("layout(local_size_x = 1) in;\nvoid main() {}", "comp", "vulkan")
    )
    calls = {name: gl.ffi.cast(kind, gl_context.fn._resolve(name)) for name, kind in CALLS.items()}
    compiled = {}
    for entry in (b"main", b"nobody"):
        shader = calls["glCreateShader"](COMPUTE_SHADER)
        calls["glShaderBinary"](1, gl.ffi.new("GLuint[1]", [shader]), SPIR_V, code, len(code))
        calls["glSpecializeShaderARB"](shader, entry, 0, gl.NULL, gl.NULL)
        compiled[entry] = state(calls["glGetShaderiv"], shader, COMPILE_STATUS)
        calls["glDeleteShader"](shader)
    assert compiled[b"main"] and not compiled[b"nobody"]
    assert gl_context.fn.glGetError() != gl.GL_NO_ERROR
    gl_context.sink.messages.clear()
