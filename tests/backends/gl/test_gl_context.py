"""The context: what it says of itself, that its calls are checked, its messages, its names, and how it ends."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from backends.contract import resolve
from backends.features import FEATURES
from backends.gl import api as gl
from backends.gl.context import Context, _headless_loader
from backends.gl.driver import capabilities as gc
from backends.gl.resources import create_buffer, create_image, create_sampler, destroy_buffer, destroy_image
from backends.shader_text import build_text
from common.errors import DeviceError, UnsupportedError, UserError
from common.paths import ROOT
from common.scene import Sampler
from tests.support.gl_functions import assert_silent


def integer(context: Context, name: int) -> int:
    out = gl.ffi.new("GLint[4]")
    context.fn.glGetIntegerv(name, out)
    return int(out[0])


# --- what it says of itself -------------------------------------------------------------------------------------------


@pytest.mark.feature("device/capability-report")
def test_every_feature_is_there_or_has_a_reason(gl_context):
    found = gl_context.capabilities
    assert found.backend == "gl" and found.api_version >= (4, 5, 0)
    assert found.device and found.driver
    assert found.features | found.why_not.keys() == FEATURES.keys()
    assert not found.features & found.why_not.keys()
    assert all(found.limits[name] > 0 for name in found.limits)
    assert found.limits["maxImageDimension2D"] >= 16384 or not found.is_software


@pytest.mark.feature("device/capability-report")
@pytest.mark.usefixtures("gl_context")  # which skips it where there is no OpenGL
def test_a_feature_switched_off_takes_the_path_of_a_device_that_lacks_it():
    with Context(without={"anisotropy", "fp64"}) as context:
        assert not context.has("anisotropy") and not context.has("fp64")
        assert context.has("wireframe")
        plan = resolve({"wireframe"}, {"anisotropy"}, context.capabilities, context.without)
        assert plan.native("wireframe") and not plan.native("anisotropy")
        # A sampler that asks for it all the same gets plain trilinear filtering, and no error.
        made = create_sampler(context, Sampler("linear", "linear", "linear"), 16.0, "trilinear")
        context.destroy("sampler", made)
    with pytest.raises(UserError, match="anisotropy"):
        Context(without={"anisotropi"})


@pytest.mark.parametrize(
    ("vendor", "renderer", "kind"),
    [
        ("Mesa", "llvmpipe (LLVM 15.0.6, 256 bits)", "software"),
        ("Mesa", "softpipe", "software"),
        ("Google Inc.", "Google SwiftShader", "software"),
        ("NVIDIA Corporation", "NVIDIA GeForce RTX 4090/PCIe/SSE2", "discrete"),
        ("NVIDIA Corporation", "NVIDIA Tegra X1", "integrated"),
        ("Intel", "Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "integrated"),
        ("Intel", "Mesa Intel(R) Arc(tm) A770 Graphics (DG2)", "discrete"),
        ("AMD", "AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 17)", "discrete"),
        ("AMD", "AMD Radeon Graphics (radeonsi, renoir, LLVM 15)", "integrated"),
        ("Mesa", "virgl (NVIDIA GeForce RTX 3080)", "virtual"),
        ("Microsoft Corporation", "D3D12 (Intel(R) Iris(R) Xe Graphics)", "virtual"),
        ("Somebody", "Something", "other"),
    ],
)
def test_the_kind_of_device_follows_from_the_driver_s_strings(vendor, renderer, kind):
    assert gc.kind_of(vendor, renderer) == kind


def test_a_driver_that_lists_an_extension_without_its_call_lacks_the_feature(gl_context):
    """Some drivers list what they do not have: the list alone is not believed."""
    address = gl_context._loader.load_opengl_function
    lying = gl.Functions(lambda name: 0 if name == "glMultiDrawElementsIndirectCountARB" else address(name))
    found = gc.probe(lying)
    if "GL_ARB_indirect_parameters" not in gc.extensions(gl_context.fn):
        pytest.skip("the driver does not list GL_ARB_indirect_parameters")
    assert "draw-indirect-count" not in found.features
    assert "glMultiDrawElementsIndirectCountARB" in found.why_not["draw-indirect-count"]
    with pytest.raises(UnsupportedError, match=r"has no glMultiDrawElementsIndirectCountARB: install"):
        lying.glMultiDrawElementsIndirectCountARB(0, 0, gl.NULL, 0, 0, 0)


@pytest.mark.parametrize(
    ("version", "limit"), [((4, 3, 0), 16), ((4, 5, 0), 8)], ids=["an old version", "too few buffers"]
)
def test_a_context_below_the_floor_is_refused_in_a_few_words(gl_context, version, limit):
    from dataclasses import replace

    limits = {**gl_context.limits, "maxPerStageDescriptorStorageBuffers": limit}
    offered = gc.extensions(gl_context.fn)
    reason = gc.unfit(replace(gl_context.capabilities, api_version=version, limits=limits), offered)
    assert reason and "is needed" in reason
    assert gc.unfit(gl_context.capabilities, offered) is None


def test_a_context_without_an_extension_that_every_vertex_shader_asks_for_is_refused(gl_context):
    prelude = build_text("void main() {}\n", "vert", "gl").text
    asked = set(re.findall(r"#extension (\w+) : require", prelude))
    assert asked == set(gc.REQUIRED)
    offered = gc.extensions(gl_context.fn)
    for name in asked:
        assert gc.unfit(gl_context.capabilities, offered - {name}) == f"the driver lacks {name}"


# --- where there is none ----------------------------------------------------------------------------------------------


def run(code: str, **environment: str) -> str:
    """Return what `code` prints in a process of its own, which must end well."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


SAY = """
from backends.gl.context import Context
from common.errors import UnsupportedError
try:
    Context()
except UnsupportedError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "environment",
    [{"GLCONTEXT_LINUX_LIBEGL": "libno-such-egl.so"}, {"MESA_GL_VERSION_OVERRIDE": "3.3"}],
    ids=["no EGL", "OpenGL 3.3"],
)
def test_without_opengl_45_there_is_one_sentence(gl_context, environment):
    if sys.platform != "linux" or not gl_context.capabilities.is_software:
        pytest.skip("these ways to take OpenGL away are those of Mesa on Linux")
    said = run(SAY, **environment).strip()
    assert said.startswith("No OpenGL 4.5 was found (")
    assert said.endswith("): ./strata doctor says what to install.") and "\n" not in said


@pytest.mark.parametrize(
    ("version", "says"),
    [
        (b"3.3.0 Old Driver 1.2", r"it offers OpenGL 3\.3\.0"),
        (b"4.4", r"it offers OpenGL 4\.4"),
        *((text, "no version") for text in (b"", b"4", b"OpenGL ES 3.2", b"x.5", b"4.x")),
    ],
)
def test_an_old_context_of_a_window_is_refused_before_it_is_used(gl_context, version, says):
    """A window's context is whatever the desktop gives: its version is read before anything newer is called."""
    called = []

    class Old:
        def load_opengl_function(self, name):
            called.append(name)
            if name == "glGetString":
                self.text = gl.ffi.new("char[]", version)
                self.call = gl.ffi.callback("const GLubyte *(GLenum)", lambda _: self.text)
                return int(gl.ffi.cast("uintptr_t", self.call))
            return 0

        def __enter__(self):
            return self

        def release(self):
            called.append("released")

    with pytest.raises(UnsupportedError, match=says):
        Context(loader=Old())
    assert called == ["glGetString", "eglReleaseThread", "released"]


# --- checked calls and messages ---------------------------------------------------------------------------------------


@pytest.mark.feature("device/checked-calls")
def test_a_failing_call_raises_with_its_name_and_arguments(gl_context):
    with pytest.raises(DeviceError, match=r"glEnable\(0x1234\) failed with GL_INVALID_ENUM: "):
        gl_context.fn.glEnable(0x1234)
    assert gl_context.fn.glGetError() == gl.GL_NO_ERROR
    gl_context.sink.messages.clear()


@pytest.mark.feature("device/validation-log")
def test_a_bad_call_reaches_every_callback_once_with_pass_and_line(gl_context):
    """moderngl never raises on an error of OpenGL's: its calls are heard through the driver's messages."""
    heard: list[list[object]] = [[], []]
    gl_context.sink.callbacks += [heard[0].append, heard[1].append]
    try:
        with gl_context.label("frame"), gl_context.label("shadows"):
            gl_context.mgl.enable_direct(0x1234)
            line = sys._getframe().f_lineno - 1
    finally:
        gl_context.sink.callbacks.clear()
    assert heard[0] == heard[1] and len(heard[0]) == 1
    message = next(iter(gl_context.sink.messages))
    assert message.severity == "error" and "INVALID_ENUM" in message.text
    assert message.labels == ("frame", "shadows")
    assert message.line == f"tests/backends/gl/test_gl_context.py:{line}"
    assert gl_context.sink.report() == [str(message)]
    gl_context.sink.messages.clear()
    gl_context.fn.glGetError()


@pytest.mark.feature("device/validation-log")
def test_the_same_message_is_kept_once_with_its_count(gl_context):
    for _ in range(3):
        gl_context.mgl.enable_direct(0x1234)
    assert list(gl_context.sink.messages.values()) == [3]
    assert gl_context.sink.report()[0].endswith("(3 times)")
    gl_context.sink.messages.clear()
    gl_context.fn.glGetError()


@pytest.mark.feature("device/validation-log")
def test_a_message_fails_the_test_that_caused_it(gl_context):
    """What every test with an OpenGL context ends with, held against what must fail it."""
    assert_silent(gl_context)
    gl_context.mgl.enable_direct(0x1234)
    with pytest.raises(AssertionError, match="INVALID_ENUM"):
        assert_silent(gl_context)
    gl_context.begin_label("left open")
    with pytest.raises(AssertionError, match="left open"):
        assert_silent(gl_context)
    gl_context.end_label()


@pytest.mark.feature("device/debug-names-and-markers")
def test_objects_carry_their_names(gl_context):
    buffer = create_buffer(gl_context, 16, "device", "vertices of the atrium")
    out, length = gl.ffi.new("GLchar[64]"), gl.ffi.new("GLsizei *")
    gl_context.fn.glGetObjectLabel(gl.GL_BUFFER, buffer.handle, 64, length, out)
    assert gl.text(out) == "vertices of the atrium"
    destroy_buffer(gl_context, buffer)


@pytest.mark.feature("device/debug-names-and-markers")
def test_the_driver_hears_each_group_by_its_name_in_order(gl_context):
    """KHR_debug: opening and closing a group are messages, both with the text of the group."""
    heard = []
    kinds = {gl.GL_DEBUG_TYPE_PUSH_GROUP: "open", gl.GL_DEBUG_TYPE_POP_GROUP: "close"}

    def note(source, kind, number, severity, length, text, user):
        if source == gl.GL_DEBUG_SOURCE_APPLICATION and kind in kinds:
            heard.append((kinds[kind], gl.ffi.buffer(text, length)[:].decode()))

    callback, any_, fn = gl.ffi.callback("GLDEBUGPROC", note), gl.GL_DONT_CARE, gl_context.fn
    fn.glDebugMessageCallback(callback, gl.NULL)
    fn.glDebugMessageControl(any_, any_, gl.GL_DEBUG_SEVERITY_NOTIFICATION, 0, gl.NULL, 1)
    try:
        with gl_context.label("frame"):
            with gl_context.label("shadows"):
                pass
            with gl_context.label("tone mapping: é"):
                pass
    finally:
        gl_context.sink.listen(fn)
    assert heard == [
        ("open", "frame"),
        ("open", "shadows"),
        ("close", "shadows"),
        ("open", "tone mapping: é"),
        ("close", "tone mapping: é"),
        ("close", "frame"),
    ]


# --- conventions ------------------------------------------------------------------------------------------------------


def test_the_rasteriser_follows_vulkan_s_conventions(gl_context):
    assert integer(gl_context, 0x935C) == gl.GL_LOWER_LEFT  # GL_CLIP_ORIGIN
    assert integer(gl_context, 0x935D) == gl.GL_ZERO_TO_ONE  # GL_CLIP_DEPTH_MODE
    assert integer(gl_context, 0x8E4F) == gl.GL_FIRST_VERTEX_CONVENTION  # GL_PROVOKING_VERTEX
    assert gl_context.fn.glIsEnabled(gl.GL_TEXTURE_CUBE_MAP_SEAMLESS)
    assert not gl_context.fn.glIsEnabled(gl.GL_DITHER)


@pytest.mark.feature("device/direct-state-access")
def test_making_and_changing_objects_leaves_what_is_bound(gl_context):
    names = (
        gl.GL_ARRAY_BUFFER_BINDING,
        gl.GL_PIXEL_PACK_BUFFER_BINDING,
        gl.GL_PIXEL_UNPACK_BUFFER_BINDING,
        gl.GL_TEXTURE_BINDING_2D,
        gl.GL_DRAW_FRAMEBUFFER_BINDING,
        gl.GL_VERTEX_ARRAY_BINDING,
    )
    from backends.gl.draws import Stream, create_vertex_array
    from backends.gl.readback import Readback, read_image
    from backends.gl.resources import write_buffer, write_image
    from backends.gl.targets import create_framebuffer, destroy_framebuffer

    marker = create_buffer(gl_context, 16, "device", "marker")
    gl_context.fn.glBindBuffer(gl.GL_ARRAY_BUFFER, marker.handle)
    before = [integer(gl_context, name) for name in names]
    assert before[0] == marker.handle
    buffer = create_buffer(gl_context, 64, "device", "buffer")
    write_buffer(gl_context, buffer, np.zeros(16, np.float32))
    image = create_image(gl_context, "rgba8", (4, 4), "image", levels=2, view_format="rgba8_srgb")
    write_image(gl_context, image, np.zeros((4, 4, 4), np.uint8))
    array = create_vertex_array(gl_context, [Stream(0, 3, 0)], buffer, buffer, "array")
    framebuffer = create_framebuffer(gl_context, [image], None, "framebuffer")
    readback = Readback(gl_context, image, "readback")
    readback.record()
    read_image(gl_context, image)
    assert [integer(gl_context, name) for name in names] == before
    gl_context.fn.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer.handle)
    assert [integer(gl_context, name) for name in names] != before, "a binding that changes is noticed"
    readback.close()
    destroy_framebuffer(gl_context, framebuffer)
    gl_context.destroy("vertex array", array)
    destroy_image(gl_context, image)
    destroy_buffer(gl_context, buffer)
    gl_context.fn.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
    destroy_buffer(gl_context, marker)


# --- lifetime ---------------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/lifetime-and-leaks")
@pytest.mark.usefixtures("gl_context")  # which skips it where there is no OpenGL
def test_ctrl_c_stays_ctrl_c_where_it_left_something_alive():
    def interrupted():
        with Context() as context:
            create_buffer(context, 16, "device", "forgotten")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()


@pytest.mark.feature("device/lifetime-and-leaks")
@pytest.mark.usefixtures("gl_context")  # which skips it where there is no OpenGL
def test_closing_names_what_was_forgotten():
    context = Context()
    create_buffer(context, 16, "device", "forgotten")
    with pytest.raises(DeviceError, match=r"1 objects outlived their context: buffer 'forgotten'\."):
        context.close()
    context.close()


@pytest.mark.feature("device/lifetime-and-leaks")
def test_a_second_destruction_is_an_error(gl_context):
    buffer = create_buffer(gl_context, 16, "device", "once")
    destroy_buffer(gl_context, buffer)
    with pytest.raises(DeviceError, match="twice"):
        gl_context.destroy("buffer", buffer.handle)


def test_several_contexts_keep_their_objects_apart(gl_context):
    """Calls reach the context that is current; each keeps its own."""
    buffer = create_buffer(gl_context, 8, "device", "first")
    with Context() as other:
        twin = create_buffer(other, 8, "device", "second")
        other.fn.glNamedBufferSubData(twin.handle, 0, 4, b"abcd")
        gl_context.make_current()
        gl_context.fn.glNamedBufferSubData(buffer.handle, 0, 4, b"wxyz")
        other.make_current()
        out = gl.ffi.new("char[4]")
        other.fn.glGetNamedBufferSubData(twin.handle, 0, 4, out)
        assert gl.ffi.buffer(out)[:] == b"abcd"
        destroy_buffer(other, twin)
    gl_context.make_current()
    destroy_buffer(gl_context, buffer)


def test_importing_loads_no_driver():
    """Whatever may crash happens when a context is made, and not before."""
    said = run(
        "import sys, backends.gl.context, backends.gl.window.present, backends.gl.upload, backends.choice\n"
        "print([n for n in ('moderngl', 'glcontext', 'glfw', 'vulkan') if n in sys.modules])\n"
        "print('libEGL' in open('/proc/self/maps').read() if sys.platform == 'linux' else False)"
    )
    assert said.split("\n")[:2] == ["[]", "False"]


def test_a_missing_package_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "glcontext", None)
    with pytest.raises(UnsupportedError, match="OpenGL needs the package moderngl"):
        _headless_loader()
