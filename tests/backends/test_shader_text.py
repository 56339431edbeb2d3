"""The shader builder: what it expands, what it refuses, and that every line can be traced to its file."""

from __future__ import annotations

import dataclasses
import random
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from backends import shader_text
from backends.shader_text import ShaderSource, build, build_text, describe_errors, literal
from backends.vulkan.shaders import glslang
from common.errors import ShaderError, UnsupportedError
from common.paths import ROOT

loader_includes = pytest.mark.feature("shaders/loader-includes")


def write(folder: Path, **files: str) -> Path:
    """Write name=text files (`__` stands for a folder, the suffix .glsl is added) and return the folder."""
    for name, text in files.items():
        path = folder / (name.replace("__", "/") + ".glsl")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")
    return folder


def body(source: ShaderSource) -> list[tuple[str, int, str]]:
    """Return (file, line, text) of the code after the prelude, following `#line` as a compiler does."""
    lines = source.text.split("\n")
    start = lines.index("#line 1 1")
    result, index, number = [], 0, 0
    for line in lines[start:-1]:
        mark = re.fullmatch(r"#line (\d+) (\d+)", line)
        if mark:
            number, index = int(mark[1]), int(mark[2])
            continue
        if not re.match(r"#(ifndef|define) INCLUDED_|#endif$", line):
            result.append((Path(source.files[index].name).stem.strip("<>"), number, line))
        number += 1
    return result


def names(source: ShaderSource) -> str:
    """Return the text of all non-empty lines, joined by blanks."""
    return " ".join(text for _, _, text in body(source) if text)


def compiled(source: ShaderSource) -> bytes:
    try:
        return glslang.compile_text(source.text, source.stage)
    except UnsupportedError as error:
        pytest.skip(str(error))


# --- includes -----------------------------------------------------------------------------------------------

EXPANSIONS = {
    # what: (main, files, expected lines)
    "none": ("a", {}, "a"),
    "one": ('#include "x.glsl"\na', {"x": "X"}, "X a"),
    "between": ('a\n#include "x.glsl"\nb', {"x": "X"}, "a X b"),
    "nested": ('#include "x.glsl"\na', {"x": '1\n#include "y.glsl"\n2', "y": "Y"}, "1 Y 2 a"),
    "twice": ('#include "x.glsl"\na\n#include "x.glsl"\nb', {"x": "X"}, "X a b"),
    "diamond": (
        '#include "x.glsl"\n#include "y.glsl"',
        {"x": '#include "z.glsl"\nX', "y": '#include "z.glsl"\nY', "z": "Z"},
        "Z X Y",
    ),
    "folder": ('#include "sub/x.glsl"', {"sub__x": '#include "y.glsl"\nX', "sub__y": "Y"}, "Y X"),
    "up": ('#include "sub/x.glsl"', {"sub__x": '#include "../y.glsl"\nX', "y": "Y"}, "Y X"),
    "same file by two names": (
        '#include "x.glsl"\n#include "sub/../x.glsl"\na',
        {"x": "X", "sub__y": ""},
        "X a",
    ),
    "spaces": ('  #  include   "x.glsl"  \na', {"x": "X"}, "X a"),
    "comment behind": ('#include "x.glsl" // why\na', {"x": "X"}, "X a"),
    "block comment behind": ('#include "x.glsl" /* why */\na', {"x": "X"}, "X a"),
    "comment before": ('/* why */ #include "x.glsl"\na', {"x": "X"}, "X a"),
    "no last newline": ('#include "x.glsl"\na', {"x": "X"}, "X a"),
    "CRLF": ('#include "x.glsl"\r\na\r\n', {"x": "X\r\n"}, "X a"),
}


@loader_includes
@pytest.mark.parametrize("case", EXPANSIONS)
def test_includes_expand_as_tabulated(tmp_path: Path, case: str) -> None:
    main, files, expected = EXPANSIONS[case]
    write(tmp_path, main=main, **files)
    assert names(build(tmp_path / "main.glsl", "vulkan", stage="frag")) == expected


COMMENTED = {
    "line": '// #include "x.glsl"',
    "block": '/* #include "x.glsl" */',
    "long block": '/* a\n#include "x.glsl"\n*/',
    "block that opens behind a closed one": '/* a */ /* b\n#include "x.glsl"\n*/',
    "block begun by slash star slash": '/*/\n#include "x.glsl"\n*/',
    "word in a line comment": '// see /*\n// #include "x.glsl"',
}


@loader_includes
@pytest.mark.parametrize("case", COMMENTED)
def test_an_include_in_a_comment_is_none(case: str) -> None:
    text = COMMENTED[case] + "\nvoid main() {}"
    assert "x.glsl" in names(build_text(text, "frag", "vulkan"))  # the missing file was not looked for


def test_an_include_after_a_comment_counts(tmp_path: Path) -> None:
    write(tmp_path, main='/* a\n*/\n// /*\n#include "x.glsl"\n/**/\nb', x="X")
    assert "X" in names(build(tmp_path / "main.glsl", "vulkan", stage="frag")).split()


def random_tree(folder: Path, generator: random.Random) -> dict[str, list[str]]:
    """Write up to 12 files that include later ones at random, some twice, and return their lines."""
    count = generator.randrange(2, 12)
    texts = {}
    for i in range(count):
        lines = [
            f"// {i} {k}" if generator.random() < 0.3 else f"f{i}_{k}" for k in range(generator.randrange(6))
        ]
        for _ in range(generator.randrange(4)):
            if i + 1 < count:
                target = generator.randrange(i + 1, count)
                lines.insert(generator.randrange(len(lines) + 1), f'#include "f{target}.glsl"')
        texts[f"f{i}"] = lines
    write(folder, **{name: "\n".join(lines) for name, lines in texts.items()})
    return texts


@loader_includes
@pytest.mark.parametrize("seed", range(40))
def test_every_line_of_a_random_tree_comes_once_in_order_with_its_place(tmp_path: Path, seed: int) -> None:
    texts = random_tree(tmp_path, random.Random(seed))
    expected: list[tuple[str, int, str]] = []
    seen: set[str] = set()

    def walk(name: str) -> None:
        seen.add(name)
        for number, line in enumerate(texts[name], start=1):
            if line.startswith("#include"):
                target = line.split('"')[1].removesuffix(".glsl")
                if target not in seen:
                    walk(target)
            else:
                expected.append((name, number, line))

    walk("f0")
    source = build(tmp_path / "f0.glsl", "vulkan", stage="frag")
    assert [line for line in body(source) if line[2]] == [line for line in expected if line[2]]
    assert {Path(file.name).stem for file in source.files[1:]} == seen


@loader_includes
@pytest.mark.parametrize(
    ("files", "circle"),
    [
        ({"main": '#include "main.glsl"'}, "main main"),
        ({"main": '#include "x.glsl"', "x": 'a\n#include "main.glsl"'}, "main x main"),
        ({"main": '#include "x.glsl"', "x": '#include "y.glsl"', "y": '#include "x.glsl"'}, "x y x"),
    ],
)
def test_a_circle_raises_with_its_names(tmp_path: Path, files: dict[str, str], circle: str) -> None:
    write(tmp_path, **files)
    with pytest.raises(ShaderError) as caught:
        build(tmp_path / "main.glsl", "vulkan", stage="frag")
    shown = " -> ".join(str(tmp_path / f"{name}.glsl") for name in circle.split())
    assert f"in a circle: {shown}" in str(caught.value)


CONDITIONS = [(a, b) for a in (0, 1) for b in (0, 1)]


@loader_includes
@pytest.mark.parametrize(("first", "second"), CONDITIONS)
def test_once_only_holds_under_conditions(tmp_path: Path, first: int, second: int) -> None:
    """A file that a condition left out is still there for the next include, and never there twice."""
    write(
        tmp_path,
        x="float x() { return 1.0; }",
        y='#include "x.glsl"\nfloat y() { return x(); }',
        main="#if FIRST\n"
        '#include "x.glsl"\n'
        "#endif\n"
        "#if SECOND\n"
        '#include "y.glsl"\n'
        "#else\n"
        '#include "x.glsl"\n'
        "float y() { return x(); }\n"
        "#endif\n"
        '#include "x.glsl"\n'
        "layout(location = 0) out float o;\n"
        "void main() { o = x() + y(); }\n",
    )
    defines = {"FIRST": first, "SECOND": second}
    assert compiled(build(tmp_path / "main.glsl", "vulkan", stage="frag", defines=defines))


def test_a_place_under_a_condition_is_right_too(tmp_path: Path) -> None:
    write(
        tmp_path, x="\n\nfloat x() { return oops; }", main='#if 1\n#include "x.glsl"\n#endif\nvoid main() {}'
    )
    source = build(tmp_path / "main.glsl", "vulkan", stage="frag")
    assert f"{tmp_path / 'x.glsl'}:3: error: 'oops'" in failure(source)


@loader_includes
def test_files_are_looked_for_beside_then_in_the_roots_in_order(tmp_path: Path) -> None:
    near, first, second = (tmp_path / name for name in ("near", "first", "second"))
    write(near, a="near", main='#include "a.glsl"\n#include "b.glsl"\n#include "c.glsl"')
    write(first, a="first", b="first")
    write(second, a="second", b="second", c="second")
    source = build(near / "main.glsl", "vulkan", stage="frag", roots=(first, second))
    assert names(source) == "near first second"


def test_the_repository_s_shaders_are_the_last_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shader_text, "SHADERS", write(tmp_path / "repo", a="repo", b="repo"))
    root = write(tmp_path / "chapter", a="chapter")
    source = build_text('#include "a.glsl"\n#include "b.glsl"', "frag", "vulkan", roots=[root])
    assert names(source) == "chapter repo"
    assert shader_text.ROOT / "shaders" == ROOT / "shaders"


@loader_includes
def test_snippets_are_files_from_python(tmp_path: Path) -> None:
    write(tmp_path, frame="disk", x='#include "frame.glsl"\nX')
    snippets = {"frame.glsl": 'python\n#include "y.glsl"', "y.glsl": "Y"}
    source = build_text(
        '#include "x.glsl"\n#include "frame.glsl"\na', "frag", "vulkan", roots=[tmp_path], snippets=snippets
    )
    assert names(source) == "python Y X a"
    assert [file.name for file in source.files][3:] == ["<frame.glsl>", "<y.glsl>"]
    assert source.key != build_text(
        '#include "x.glsl"\n#include "frame.glsl"\na', "frag", "vulkan", roots=[tmp_path]
    ).key  # fmt: skip


@loader_includes
def test_a_file_with_a_byte_order_mark_compiles(tmp_path: Path) -> None:
    (tmp_path / "x.glsl").write_bytes(b"\xef\xbb\xbffloat x() { return 1.0; }\n")
    (tmp_path / "m.frag").write_bytes(b'\xef\xbb\xbf#include "x.glsl"\nvoid main() { float y = x(); }\n')
    assert compiled(build(tmp_path / "m.frag", "vulkan"))


def test_line_ends_and_folders_do_not_change_the_key(tmp_path: Path) -> None:
    one = write(tmp_path / "one", main='#include "x.glsl"\nvoid main() {}\n', x="int a;\n")
    two = write(tmp_path / "two", main='#include "x.glsl"\r\nvoid main() {}\r\n', x="int a;\r\n")
    sources = [build(folder / "main.glsl", "vulkan", stage="frag") for folder in (one, two)]
    assert sources[0].key == sources[1].key
    assert sources[0].files != sources[1].files


def test_whatever_the_compiler_sees_changes_the_key() -> None:
    def key(text: str = "void main() {}", stage: str = "frag", **more: object) -> str:
        return build_text(text, stage, "vulkan", **more).key  # type: ignore[arg-type]

    keys = [
        key(),
        key("void main() { }"),
        key(stage="comp"),
        key(defines={"A": 1}),
        key(defines={"A": 1.0}),
        key(extensions=["GL_EXT_ray_query"]),
        build_text("void main() {}", "frag", "gl").key,
    ]
    assert len(set(keys)) == len(keys)
    assert key() == key(name="another")


def test_an_extension_stands_before_everything_where_the_file_that_needs_it_is_included(
    tmp_path: Path,
) -> None:
    write(
        tmp_path,
        lib__far="int far;",
        near='#include "lib/far.glsl"',
        main='#include "near.glsl"',
        alone="int a;",
    )
    needs = {"far.glsl": "GL_EXT_nonuniform_qualifier"}

    def made(name: str, extensions: tuple[str, ...] = (), **more: object) -> ShaderSource:
        return build(tmp_path / f"{name}.glsl", "vulkan", stage="frag", extensions=extensions, **more)  # type: ignore[arg-type]

    found = made("main", extensions_with=needs)
    assert found == made("main", ("GL_EXT_nonuniform_qualifier",))
    assert found.text.split("\n")[1] == "#extension GL_EXT_nonuniform_qualifier : require"
    assert found.files[0].lines[1] == found.text.split("\n")[1]  # what messages show of the prelude
    assert made("alone", extensions_with=needs) == made("alone")


def test_a_source_cannot_be_changed() -> None:
    source = build_text("void main() {}", "frag", "vulkan")
    with pytest.raises(dataclasses.FrozenInstanceError):
        source.text = ""  # type: ignore[misc]


# --- what is refused ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ('#include "nowhere.glsl"', "there is no file 'nowhere.glsl' in"),
        ("#include <x.glsl>", 'an include is written #include "name.glsl"'),
        ('#include "x.glsl', 'an include is written #include "name.glsl"'),
        ("#include x.glsl", 'an include is written #include "name.glsl"'),
        ("#include", 'an include is written #include "name.glsl"'),
        ("#version 450", "leave this line out"),
        ("#if 1", "in the same file"),
        ("#endif", "in the same file"),
    ],
)
def test_a_wrong_line_is_named_with_place_and_chain(tmp_path: Path, line: str, part: str) -> None:
    write(tmp_path, main='// m\n#include "x.glsl"', x=f"\n{line}")
    with pytest.raises(ShaderError) as caught:
        build(tmp_path / "main.glsl", "vulkan", stage="frag")
    text = str(caught.value).split("\n")
    assert text[0].startswith(f"{tmp_path / 'x.glsl'}:2: error: ")
    assert part in text[0]
    assert text[1] == f"    {line}"
    assert set(text[2]) == {" ", "^"}
    assert text[3] == f"  included from {tmp_path / 'main.glsl'}:2"


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "latin.frag").write_bytes("// é".encode("latin-1"))
    (tmp_path / "zero.frag").write_bytes(b"void main() {}\0")
    (tmp_path / "folder.frag").mkdir()
    for name in ("latin", "zero", "folder", "absent"):
        with pytest.raises(ShaderError, match=f"{name}.frag"):
            build(tmp_path / f"{name}.frag", "vulkan")


def test_stages_come_from_the_suffix(tmp_path: Path) -> None:
    for stage in ("vert", "frag", "comp", "mesh", "task", "rgen", "rchit", "rahit", "rmiss", "rint", "rcall"):
        path = tmp_path / f"name.{stage}"
        path.write_text("void main() {}")
        assert build(path, "vulkan").stage == stage
    with pytest.raises(ShaderError, match=r"one of \.vert"):
        shader_text.stage_of("name.glsl")
    with pytest.raises(ShaderError, match="no shader stage 'pixel'"):
        build_text("", "pixel", "vulkan")


# --- constants ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0, "0"),
        (7, "7"),
        (-7, "(-7)"),
        (2**31 - 1, "2147483647"),
        (2**31, "2147483648u"),
        (2**32 - 1, "4294967295u"),
        (-(2**31), "(-2147483647 - 1)"),
        (True, "1"),
        (False, "0"),
        (1.0, "1.0"),
        (-0.5, "(-0.5)"),
        (-0.0, "(-0.0)"),
        (1e-7, "1e-07"),
        (0.1, "0.1"),
        (np.float32(0.1), "0.10000000149011612"),
        (np.float64(0.1), "0.1"),
        (np.int32(-3), "(-3)"),
        ("rgba16f", "rgba16f"),
    ],
)
def test_constants_are_written_as_glsl(value: object, expected: str) -> None:
    assert literal(value) == expected


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 2**32, -(2**31) - 1, "a\nb", None, (1, 2)])
def test_what_a_macro_cannot_hold_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match="shader constant"):
        literal(value)
    with pytest.raises(ShaderError, match=r"^K: "):
        build_text("", "frag", "vulkan", defines={"K": value})  # type: ignore[dict-item]


def test_a_wrong_constant_name_is_refused() -> None:
    with pytest.raises(ShaderError, match="'2D' cannot be"):
        build_text("", "frag", "vulkan", defines={"2D": 1})


def constants(code: bytes) -> dict[int, set[int]]:
    """Return, per opcode of the type (21 integer, 22 float), the words of all 32-bit OpConstants (43)."""
    words = struct.unpack(f"={len(code) // 4}I", code)
    kinds: dict[int, int] = {}
    found: dict[int, set[int]] = {21: set(), 22: set()}
    at = 5
    while at < len(words):
        length, opcode = words[at] >> 16, words[at] & 0xFFFF
        if opcode in (21, 22):
            kinds[words[at + 1]] = opcode
        elif opcode == 43 and length == 4:
            found[kinds[words[at + 1]]].add(words[at + 3])
        at += length
    return found


def test_floats_arrive_with_all_their_bits() -> None:
    """2000 floats of all magnitudes reach SPIR-V as float32(value), through the compiler's own parser."""
    generator = np.random.default_rng(1)
    single = generator.integers(0, 2**32, 1500, dtype=np.uint32).view(np.float32)
    double = generator.standard_normal(500) * 10.0 ** generator.integers(-30, 30, 500)
    values = [float(v) for v in (*single[np.isfinite(single)], *double) if abs(v) >= 1.2e-38]
    defines = {f"K{i}": value for i, value in enumerate(values)}
    stores = "".join(f"o[{i}] = abs(K{i}) * x; " for i in range(len(values)))
    text = f"layout(BIND(0, 0, 0)) buffer B {{ float x; float o[]; }};\nvoid main() {{ {stores} }}"
    found = constants(compiled(build_text(text, "comp", "vulkan", defines=defines)))[22]
    wanted = np.abs(np.array(values)).astype(np.float32).view(np.uint32)
    missing = [value for value, word in zip(values, wanted, strict=True) if int(word) not in found]
    assert not missing


def test_integers_and_flags_arrive_as_they_are() -> None:
    text = """
layout(BIND(0, 0, 0)) buffer B { int x; int i[4]; uint u[2]; };
void main() {
    i[0] = LOW * x; i[1] = MINUS * x; u[0] = HIGH * uint(x);
#if ON && !OFF
    i[2] = 77 * x;
#endif
}"""
    defines = {"LOW": -(2**31), "MINUS": -7, "HIGH": 2**32 - 1, "ON": True, "OFF": False}
    found = constants(compiled(build_text(text, "comp", "vulkan", defines=defines)))[21]
    assert {2**31, 2**32 - 7, 2**32 - 1, 77} <= found


# --- messages -----------------------------------------------------------------------------------------------


@pytest.fixture
def nested(tmp_path: Path) -> ShaderSource:
    write(
        tmp_path,
        main='// 1\n#include "x.glsl"\nvoid main() {}',
        x='// 1\n// 2\n#include "y.glsl"\n\tfloat x = foo;',
        y="float y = x;",
    )
    return build(tmp_path / "main.glsl", "vulkan", stage="frag")


LOGS = {
    "glslang": ("ERROR: 2:4: 'foo' : undeclared identifier ", "error: 'foo' : undeclared identifier", 11),
    "glslang with columns": ("ERROR: 2:4:12: 'foo' : undeclared", "error: 'foo' : undeclared", 11),
    "glslang, nothing quoted": ("ERROR: 2:4: '' :  syntax error", "error: '' :  syntax error", 1),
    "glslang warning": ("WARNING: 2:4: 'foo' : odd", "warning: 'foo' : odd", 11),
    "mesa": ("2:4(12): error: `foo' undeclared", "error: `foo' undeclared", 11),
    "mesa far column": ("2:4(99): error: late", "error: late", 15),
    "nvidia": ('2(4) : error C1008: undefined variable "foo"', 'error C1008: undefined variable "foo"', 11),
}


@loader_includes
@pytest.mark.parametrize("case", LOGS)
def test_each_compiler_s_message_maps_to_file_line_caret_and_chain(
    tmp_path: Path, nested: ShaderSource, case: str
) -> None:
    log, message, column = LOGS[case]
    assert describe_errors(log, nested).split("\n") == [
        f"{tmp_path / 'x.glsl'}:4: {message}",
        "    \tfloat x = foo;",
        "    \t" + " " * (column - 1) + "^",
        f"  included from {tmp_path / 'main.glsl'}:2",
    ]


def test_two_levels_of_includes_are_both_named(tmp_path: Path, nested: ShaderSource) -> None:
    assert describe_errors("ERROR: 3:1: 'x' : undeclared", nested).split("\n")[-2:] == [
        f"  included from {tmp_path / 'x.glsl'}:3",
        f"  included from {tmp_path / 'main.glsl'}:2",
    ]


def test_what_has_no_place_is_kept_and_noise_is_not(nested: ShaderSource) -> None:
    noise = "ERROR: 2:4: '' : compilation terminated \nERROR: 2 compilation errors.  No code generated.\n\n"
    assert describe_errors(f"ERROR: Linking: Missing entry point\n{noise}", nested) == (
        f"{nested.name}: Linking: Missing entry point"
    )
    assert nested.name in describe_errors("", nested)
    assert "does not say why" in describe_errors(noise, nested)
    assert describe_errors("ERROR: 99:1: what", nested) == f"{nested.name}: 99:1: what"
    assert (
        describe_errors("ERROR: 2:400: 'foo' : end", nested)
        .split("\n")[0]
        .endswith("x.glsl:400: error: 'foo' : end")
    )
    same = "ERROR: 2:4: 'foo' : undeclared\n"
    assert describe_errors(same * 3, nested) == describe_errors(same, nested)


def test_an_error_in_a_constant_shows_the_prelude() -> None:
    source = build_text("void main() { float x = K; }\n", "frag", "vulkan", defines={"K": "1.0 +"})
    assert "float x = K" in failure(source)
    source = build_text("", "frag", "vulkan", extensions=["GL_no_such"])
    assert failure(source).startswith(  # and the shader's name: every shader has a prelude
        "<text>: <prelude>:2: error: '#extension' : extension not supported: GL_no_such"
    )


def failure(source: ShaderSource) -> str:
    with pytest.raises(glslang.CompilationFailed) as caught:
        compiled(source)
    return describe_errors(str(caught.value), source)


@loader_includes
@pytest.mark.parametrize("seed", range(12))
def test_the_compiler_s_own_messages_map_back_from_any_file(tmp_path: Path, seed: int) -> None:
    """One wrong line anywhere in a random tree is found again by glslang at its file and line."""
    generator = random.Random(seed)
    texts = random_tree(tmp_path, generator)
    reached = {Path(f.name).stem for f in build(tmp_path / "f0.glsl", "vulkan", stage="frag").files[1:]}
    wrong = generator.choice(sorted(reached))
    for name, lines in texts.items():
        lines[:] = [line if line.startswith(("#", "//")) else f"const float {line} = 1.0;" for line in lines]
        if name == wrong:
            line = generator.randrange(len(lines) + 1)
            lines.insert(line, "const float wrong = missing;")
    texts["f0"].append("void main() {}")
    write(tmp_path, **{name: "\n".join(lines) for name, lines in texts.items()})
    shown = failure(build(tmp_path / "f0.glsl", "vulkan", stage="frag"))
    assert shown.startswith(f"{tmp_path / wrong}.glsl:{line + 1}: error: 'missing' : undeclared identifier")
    assert "\n    const float wrong = missing;\n                        ^" in shown


# --- the OpenGL side ----------------------------------------------------------------------------------------


def test_the_preludes_say_which_backend_it_is() -> None:
    text = "#if BACKEND_VULKAN == BACKEND_GL\n#error same\n#endif\nvoid main() {}"
    assert compiled(build_text(text, "frag", "vulkan"))
    for backend, version in (("vulkan", "460"), ("gl", "450")):
        source = build_text(text, "vert", backend, extensions=["GL_A", "GL_A"])  # type: ignore[arg-type]
        assert source.text.startswith(f"#version {version}\n")
        assert source.text.count("GL_A :") == 1
        # Extensions must come before any code.
        assert source.text.index("#extension") < source.text.index("#line")


SHARED = """
struct Push { vec4 scale; };
PUSH(Push, pc)
layout(BIND(0, 0, 0), std430) buffer Ids { float ids[]; };
layout(location = 0) out float id;
void main() {
    ids[VERTEX_ID] = float(INSTANCE_ID) * pc.scale.x * K;
    gl_Position = vec4(0.0);
    id = 1.0;
}"""


def test_one_text_compiles_on_both_apis(gl: object) -> None:
    assert compiled(build_text(SHARED, "vert", "vulkan", defines={"K": 0.5}))
    program = gl.program(  # type: ignore[attr-defined]
        vertex_shader=build_text(SHARED, "vert", "gl", defines={"K": 0.5}).text, varyings=["id"]
    )
    assert program["Ids"].binding == 0
    assert program["PushBlock_"].binding == 14
    program.release()


@loader_includes
def test_messages_of_the_gl_driver_map_back(tmp_path: Path, gl: object) -> None:
    write(
        tmp_path,
        main='\n#include "x.glsl"\nlayout(local_size_x = 1) in;\nvoid main() {}',
        x="\n\nfloat x = oops;",
    )
    if " Mesa 22." in gl.info["GL_VERSION"]:  # type: ignore[attr-defined]
        pytest.skip("Mesa 22 forgets of which file a line is")
    source = build(tmp_path / "main.glsl", "gl", stage="comp")
    with pytest.raises(Exception, match="oops") as caught:
        gl.compute_shader(source.text)  # type: ignore[attr-defined]
    log = "\n".join(line for line in str(caught.value).splitlines() if "(" in line)
    shown = describe_errors(log, source)
    assert f"{tmp_path / 'x.glsl'}:3: " in shown
    assert "\n    float x = oops;\n              ^" in shown
    assert f"included from {tmp_path / 'main.glsl'}:2" in shown


@pytest.fixture(scope="module")
def gl() -> object:
    from backends.gl.context import Context
    from common.errors import UnsupportedError

    try:
        context = Context()  # which leaves the thread without a context when it is closed: windows need that
    except UnsupportedError as error:
        pytest.skip(f"no OpenGL: {error}")
    yield context.mgl
    context.close()


PLAIN_TEXT = """#define TWICE(x) \\
    (2.0 * (x))
#ifdef NORMAL_MAP
const float a = 1.0;
#endif
// Says nothing.
void main() {
    float b = TWICE(1.0);  // nor does this
}
"""
SAME_CODE = {
    "a comment": ("// Says nothing.", "/* Says\n\nmore */"),
    "a comment behind code": ("  // nor does this", ""),
    "spaces": ("    float b = ", "\tfloat  b =  "),
    "an empty line": ("void main() {", "\nvoid main() {"),
    "what is left out": ("const float a = 1.0;", "const float a = 2.0;"),
}
OTHER_CODE = {
    "a number": ("TWICE(1.0)", "TWICE(2.0)"),
    "a condition": ("#ifdef NORMAL_MAP", "#ifndef NORMAL_MAP"),
    "a macro that ends before": ("\\\n    (2.0", "\\\n\n    (2.0"),
    "a comment that goes on": ("// Says nothing.", "// Says nothing. \\"),
    "the number of a line": ("    float b = ", "    // a line\n    float c = float(__LINE__), b = "),
}


def test_what_no_compiler_makes_anything_of_does_not_change_the_key() -> None:
    """Else a driver would build pipelines anew, for seconds, that stay as they are."""

    def key(old: str = "", new: str = "") -> str:
        assert PLAIN_TEXT.count(old) == 1 or not old
        return build_text(PLAIN_TEXT.replace(old, new) if old else PLAIN_TEXT, "frag", "gl").key

    for what, (old, new) in SAME_CODE.items():
        assert key(old, new) == key(), what
    for what, (old, new) in OTHER_CODE.items():
        assert key(old, new) != key(), what
    assert key("    float b", "    float c = float(__LINE__), b") != key(*OTHER_CODE["the number of a line"])
