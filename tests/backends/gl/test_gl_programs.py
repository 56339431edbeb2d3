"""Programs: shared, refused with the place of the mistake, and held to what every backend can bind."""

from __future__ import annotations

import pytest

from backends.gl.programs import Programs
from backends.shader_text import build, build_text
from common.errors import ShaderError
from common.paths import ROOT

VERTEX = "layout(location = 0) out vec4 c;\nvoid main() { c = vec4(%s); gl_Position = vec4(0); }"
FRAGMENT = "layout(location = 0) in vec4 c;\nlayout(location = 0) out vec4 o;\nvoid main() { o = c * %s; }"


@pytest.fixture
def programs(gl_context):
    made = Programs(gl_context)
    yield made
    made.close()


@pytest.mark.feature("device/program-variants")
def test_two_vertex_and_three_fragment_shaders_make_six_programs_once(programs):
    vertex = [build_text(VERTEX % number, "vert", "gl") for number in ("0.5", "1.5")]
    fragment = [build_text(FRAGMENT % number, "frag", "gl") for number in ("1.0", "2.0", "3.0")]
    made = {(v.key, f.key): programs.get([v, f]) for v in vertex for f in fragment}
    assert len({program.handle for program in made.values()}) == len(programs) == programs.linked == 6
    again = build_text(VERTEX % "0.5", "vert", "gl", name="the same text from elsewhere")
    assert programs.get([again, fragment[0]]) is made[again.key, fragment[0].key]
    assert programs.linked == 6


def test_a_mistake_is_shown_in_its_file_with_the_includes(programs, tmp_path):
    (tmp_path / "light.glsl").write_text("float half_of(float x) {\n    return x * undeclared;\n}\n")
    (tmp_path / "main.frag").write_text(
        '#include "light.glsl"\nlayout(location = 0) out vec4 o;\nvoid main() { o = vec4(half_of(1.0)); }\n'
    )
    with pytest.raises(ShaderError) as caught:
        programs.get([build_text(VERTEX % "0.5", "vert", "gl"), build(tmp_path / "main.frag", "gl")])
    text = str(caught.value)
    assert f"{tmp_path}/light.glsl:2: " in text and "undeclared" in text
    lines = text.splitlines()
    code = next(number for number, line in enumerate(lines) if "return x * undeclared;" in line)
    assert lines[code + 1].strip() == "^"
    assert f"included from {tmp_path}/main.frag:1" in text
    assert len(programs) == 0


@pytest.mark.feature("device/program-variants")
def test_stages_that_do_not_fit_together_are_named(programs):
    vertex = build_text(VERTEX % "1.0", "vert", "gl", name="a.vert")
    wrong = (
        "layout(location = 0) in ivec2 c; layout(location = 0) out vec4 o; void main() { o = vec4(c, c); }"
    )
    with pytest.raises(ShaderError):
        programs.get([vertex, build_text(wrong, "frag", "gl", name="b.frag")])
    with pytest.raises(ShaderError, match="no shaders of the stage 'mesh'"):
        programs.get([build_text("void main() {}", "mesh", "gl", name="c.mesh")])


def storage_buffers(count: int) -> str:
    blocks = "".join(
        f"layout(BIND(0, {i}, {i}), std430) buffer B{i} {{ uint b{i}[]; }};\n" for i in range(count)
    )
    uses = " ".join(f"b{i}[0] = {i}u;" for i in range(count))
    return f"layout(local_size_x = 1) in;\n{blocks}void main() {{ {uses} }}"


def samplers(count: int, array: bool) -> str:
    if array:
        declared = f"layout(BIND(0, 0, 0)) uniform sampler2D t[{count}];\n"
        uses = " + ".join(f"texelFetch(t[{i}], ivec2(0), 0)" for i in range(count))
    else:
        declared = "".join(f"layout(BIND(0, {i}, {i})) uniform sampler2D t{i};\n" for i in range(count))
        uses = " + ".join(f"texelFetch(t{i}, ivec2(0), 0)" for i in range(count))
    return f"layout(local_size_x = 1) in;\n{declared}buffer B {{ vec4 b; }};\nvoid main() {{ b = {uses}; }}"


def test_more_buffers_than_every_driver_has_are_refused(gl_context, programs):
    assert programs.get([build_text(storage_buffers(12), "comp", "gl")])
    alive = len(gl_context.alive)
    with pytest.raises(ShaderError, match=r"many\.comp uses 13 storage buffers; a stage may use 12"):
        programs.get([build_text(storage_buffers(13), "comp", "gl", name="many.comp")])
    assert len(gl_context.alive) == alive


@pytest.mark.parametrize("array", [False, True])
def test_more_samplers_than_every_driver_has_are_refused(programs, array):
    assert programs.get([build_text(samplers(16, array), "comp", "gl")])
    with pytest.raises(ShaderError, match=r"many\.comp uses 17 samplers; a stage may use 16"):
        programs.get([build_text(samplers(17, array), "comp", "gl", name="many.comp")])


@pytest.mark.parametrize("format", ["rgba8", "rgba16f", "rgba32f"])
def test_shared_kernels_compile_for_opengl(programs, format):
    source = build(ROOT / "shaders" / "mips.comp", "gl", defines={"FORMAT": format})
    assert programs.get([source]).handle
