"""Queries: stamps in the order of the passes, and counts that are known from the work."""

from __future__ import annotations

import pytest

from backends.gl import api as gl
from backends.gl.programs import Programs
from backends.gl.queries import Statistics, Timestamps
from backends.gl.resources import create_image, destroy_image
from backends.gl.targets import begin, create_framebuffer, destroy_framebuffer
from backends.shader_text import build_text
from common.errors import DeviceError

SIZE = (16, 8)
VERTEX = "void main() { gl_Position = vec4(VERTEX_ID == 1 ? 3 : -1, VERTEX_ID == 2 ? 3 : -1, 0.5, 1); }"
FRAGMENT = "layout(location = 0) out vec4 o; void main() { o = gl_FragCoord; }"
COMPUTE = (
    "layout(local_size_x = 8) in; buffer B { uint b[]; }; void main() { if (b.length() > 9) b[9] = 1u; }"
)


@pytest.fixture
def draw(gl_context):
    """Return a function that draws one triangle over 16x8 pixels."""
    programs = Programs(gl_context)
    program = programs.get([build_text(VERTEX, "vert", "gl"), build_text(FRAGMENT, "frag", "gl")])
    image = create_image(gl_context, "rgba16f", SIZE, "image")
    framebuffer = create_framebuffer(gl_context, [image], None, "framebuffer")
    vertices = gl_context.create("vertex array", "nothing")

    def once():
        begin(gl_context, framebuffer)
        gl_context.fn.glBindVertexArray(vertices)
        gl_context.fn.glUseProgram(program.handle)
        gl_context.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

    yield once
    gl_context.destroy("vertex array", vertices)
    destroy_framebuffer(gl_context, framebuffer)
    destroy_image(gl_context, image)
    programs.close()


@pytest.mark.feature("device/gpu-timestamps")
def test_passes_are_timed_in_the_order_of_the_frame(gl_context, draw):
    stamps = Timestamps(gl_context, "slot 0")
    assert stamps.read() == {} and stamps.ready()
    for _ in range(2):  # the second frame uses the queries of the first again
        stamps.begin_frame()
        for name in ("shadows", "forward", "nothing"):
            stamps.begin(name)
            if name != "nothing":
                draw()
            stamps.end()
        gl_context.wait_idle()
        assert stamps.ready()
        found = stamps.read()
        assert list(found) == ["shadows", "forward", "nothing"]
        assert all(0.0 <= milliseconds < 1000.0 for milliseconds in found.values())
        assert found["forward"] > 0.0
    assert sum(kind == "query" for kind, _ in gl_context.alive) == 6
    stamps.close()


def test_counts_are_those_of_the_work(gl_context, draw):
    if not gl_context.has("pipeline-statistics"):
        pytest.skip("the driver has no pipeline statistics")
    programs = Programs(gl_context)
    compute = programs.get([build_text(COMPUTE, "comp", "gl")])
    statistics = Statistics(gl_context, "counts")
    assert statistics.read() == {}
    with statistics.count():
        draw()
        gl_context.fn.glUseProgram(compute.handle)
        gl_context.fn.glDispatchCompute(5, 1, 1)
    found = statistics.read()
    statistics.close()
    programs.close()
    assert found["vertices"] == found["vertex_invocations"] == 3
    assert found["primitives"] == found["clipping_invocations"] == 1
    assert found["samples_passed"] == SIZE[0] * SIZE[1]
    assert found["fragment_invocations"] >= SIZE[0] * SIZE[1]
    assert found["compute_invocations"] == 40


def test_statistics_queries_need_names_without_a_target(gl_context):
    """Mesa's glCreateQueries knows no statistics; glGenQueries leaves the target to the first use."""
    address = gl_context._loader.load_opengl_function("glCreateQueries")
    create = gl.ffi.cast("void (*)(GLenum, GLsizei, GLuint *)", address)
    out = gl.ffi.new("GLuint[1]")
    create(gl.GL_VERTEX_SHADER_INVOCATIONS, 1, out)
    if gl_context.fn.glGetError() != gl.GL_INVALID_ENUM:
        gl_context.fn.glDeleteQueries(1, out)
        pytest.skip("this driver's glCreateQueries knows statistics")
    gl_context.sink.messages.clear()
    statistics = Statistics(gl_context, "counts")
    with statistics.count():
        pass
    assert set(statistics.read().values()) == {0}
    statistics.close()


def test_without_the_feature_only_samples_are_counted(gl_context, draw, monkeypatch):
    monkeypatch.setattr(gl_context, "features", gl_context.features - {"pipeline-statistics"})
    statistics = Statistics(gl_context, "counts")
    with statistics.count():
        draw()
    assert statistics.read() == {"samples_passed": SIZE[0] * SIZE[1]}
    statistics.close()


def test_two_counts_at_once_are_an_error_and_no_wrong_number(gl_context):
    one, two = Statistics(gl_context, "one"), Statistics(gl_context, "two")
    with one.count(), pytest.raises(DeviceError, match="glBeginQuery"), two.count():
        pass
    gl_context.sink.messages.clear()
    one.close()
    two.close()
