"""What an edited text is made of: which files decide about it, where its lines are, and where a caret goes."""

from __future__ import annotations

import pytest

from backends.gl.programs import Programs
from backends.shader_text import build, describe_errors
from backends.vulkan.shaders import glslang
from backends.vulkan.shaders.compiler import Compiler
from common.errors import ShaderError
from tests.support.drivers import needs_line_marks

MAIN = """// 1
#ifdef A
#include "a.glsl"
#endif
#if defined(B) || 0
#include "b.glsl"
#else
int c;
#include "c.glsl"
#endif
layout(location = 0) out vec4 color;
void main() { color = vec4(wrong); }
"""
WRONG = 12


@pytest.fixture
def main(tmp_path):
    for name in "abc":
        (tmp_path / f"{name}.glsl").write_text("\n" * 40 + f"const float of_{name} = 1.0;\n")
    path = tmp_path / "main.frag"
    path.write_text(MAIN)
    return path


@pytest.mark.parametrize("defines", [{}, {"A": 1}, {"B": 1}, {"A": 1, "B": 1}], ids=str)
def test_lines_are_counted_rightly_behind_includes_that_a_condition_leaves_out(main, defines, gl_context):
    needs_line_marks(gl_context)
    vertex = main.with_name("main.vert")
    vertex.write_text("void main() { gl_Position = vec4(0.0); }\n")
    compilers = {
        "vulkan": Compiler(None).compile,
        "gl": lambda source: Programs(gl_context).get([build(vertex, "gl"), source]),
    }
    for backend, compiled in compilers.items():
        source = build(main, backend, defines=defines)
        with pytest.raises(ShaderError) as caught:
            compiled(source)
        first, line, caret = str(caught.value).splitlines()[:3]
        assert first.startswith(f"{main}:{WRONG}: "), (backend, first)
        assert line.strip() == MAIN.splitlines()[WRONG - 1]
        assert caret.index("^") == line.index("wrong")


def names(source):
    return {path.name for path in source.paths if path.is_file()}


CONDITIONS = {
    "#ifdef YES": True,
    "#ifdef NO": False,
    "#ifndef NO": True,
    "#ifndef YES": False,
    "#ifdef NO\n#else": True,
    "#ifdef YES\n#else": False,
    "#ifdef NO\n#ifdef YES": False,
    "#if defined(NO)": True,  # nobody evaluates it here: it might be
    "#ifdef NO\n#elif 0": True,
    "#define NO\n#ifdef NO": True,
    "#undef YES\n#ifdef YES": True,
    "#undef YES\n#ifndef YES": True,
    "#ifdef GL_EXT_something": True,
    "#ifdef VULKAN": True,
    "#ifdef BACKEND_GL": True,
}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_file_that_is_certainly_left_out_is_not_used(tmp_path, condition):
    used = CONDITIONS[condition]
    (tmp_path / "other.glsl").write_text("const float other = 1.0;\n")
    ends = "\n#endif" * condition.count("#if")
    path = tmp_path / "main.comp"
    path.write_text(f'{condition}\n#include "other.glsl"{ends}\nvoid main() {{}}\n')
    source = build(path, "vulkan", defines={"YES": 1})
    assert ("other.glsl" in names(source)) == used
    assert ("const float other" in source.text) == used
    assert source.text.splitlines()[-1] == "void main() {}"
    glslang.compile_text(source.text, "comp")


def test_every_place_where_an_include_was_looked_for_decides_about_the_text(tmp_path):
    near, far = tmp_path / "near", tmp_path / "far"
    for folder in (near, far):
        folder.mkdir()
    (far / "x.glsl").write_text("\n")
    (near / "main.comp").write_text('#include "x.glsl"\nvoid main() {}\n')
    source = build(near / "main.comp", "vulkan", roots=[far])
    assert source.paths == {near / "main.comp", near / "x.glsl", far / "x.glsl"}


def test_an_error_knows_the_files_that_may_repair_it(tmp_path):
    path = tmp_path / "main.comp"
    path.write_text('#include "x.glsl"\nvoid main() {}\n')
    with pytest.raises(ShaderError) as caught:
        build(path, "vulkan")
    assert {path, tmp_path / "x.glsl"} <= caught.value.files


@pytest.mark.parametrize(
    ("log", "at"),
    [
        ("1:1(3): error: `value' undeclared", 21),  # Mesa's column is that of the statement
        ("1:1(40): error: `value' undeclared", 29),
        ("ERROR: 1:1: 'value' : undeclared identifier", 21),
        ("1:1(6): error: syntax error, unexpected ';'", 34),
        ("1:1(6): error: something else", 5),
    ],
)
def test_the_caret_stands_below_the_word_that_is_meant(tmp_path, log, at):
    path = tmp_path / "main.comp"
    path.write_text("    float values = x+value * value;\n")
    shown = describe_errors(log, build(path, "vulkan")).splitlines()
    assert shown[1].strip() == "float values = x+value * value;"
    assert shown[2].index("^") == 4 + at
