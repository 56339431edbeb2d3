"""Builds the text of a shader for either API: includes, the backend's prelude, constants from Python.

A shader file holds no `#version` and may write `#include "name.glsl"`. The file is looked for beside the
including one, then in the roots given by the caller (a chapter's `shaders/`), then in the repository's
`shaders/`. Names in `snippets` come first: their text is made in Python, as that of the record layouts is.
A file is included once per shader, so files need no guards.

What the compiler sees is one string with `#line line index` marks. `describe_errors` turns its messages back
into files, source lines and the chain of includes.
"""

from __future__ import annotations

import hashlib
import math
import numbers
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from common.errors import ShaderError
from common.files.shader_files import File, in_memory, is_there, lines_of, load, shown_path
from common.paths import ROOT

Backend = Literal["vulkan", "gl"]
Constant = int | float | bool | str

STAGES = (
    *("vert", "tesc", "tese", "geom", "frag"),
    *("comp", "mesh", "task"),
    *("rgen", "rchit", "rahit", "rmiss", "rint", "rcall"),
)
"""File suffixes, which are also the compilers' names of the stages."""

SHADERS = ROOT / "shaders"

# BIND hides that Vulkan counts bindings per set, while OpenGL counts them per kind of resource (`k`) over the
# whole program. PUSH declares small constants: a push-constant block, or a uniform block in the last slot. A
# struct used with it holds vec4, mat4 and uvec4 only, whose layout std140 and std430 agree upon.
_PRELUDES: dict[str, str] = {
    "vulkan": """\
#version 460
{extensions}\
#define BACKEND_VULKAN 1
#define BACKEND_GL 0
#define VERTEX_ID gl_VertexIndex
#define INSTANCE_ID gl_InstanceIndex
#define BIND(s, b, k) set = s, binding = b
#define PUSH(T, n) layout(push_constant) uniform PushBlock_ {{ T n; }};
""",
    "gl": """\
#version 450
{extensions}\
#define BACKEND_VULKAN 0
#define BACKEND_GL 1
#define VERTEX_ID gl_VertexID
#define INSTANCE_ID (gl_InstanceID + gl_BaseInstanceARB)
#define BIND(s, b, k) binding = k
#define PUSH(T, n) layout(std140, binding = 14) uniform PushBlock_ {{ T n; }};
""",
}


@dataclass(frozen=True)
class SourceFile:
    """One file as it was included: its name for messages, its lines, and (index of the includer, line)."""

    name: str
    lines: tuple[str, ...] = field(repr=False)
    included_from: tuple[int, int] | None = None


@dataclass(frozen=True)
class ShaderSource:
    """A shader ready for the compiler. `files[i]` is what `#line ... i` refers to; `files[0]` is the prelude.

    `key` is the same for the same stage and code on every machine and from every folder: chapters that carry
    a shader on unchanged share its compiled form, and so does a shader in which only comments, spaces or lines that
    these constants leave out were edited. `paths` is all on disk that decides about the text: the files that
    were read, and the places where an include was looked for in vain.
    """

    stage: str
    text: str = field(repr=False)
    files: tuple[SourceFile, ...] = field(repr=False)
    key: str
    paths: frozenset[Path] = field(default=frozenset(), repr=False)

    @property
    def name(self) -> str:
        """The file that was asked for, as messages show it."""
        return self.files[1].name


def stage_of(path: Path | str) -> str:
    """Return the stage that the suffix of `path` stands for; raise ShaderError for any other suffix."""
    suffix = Path(path).suffix.removeprefix(".")
    if suffix not in STAGES:
        raise ShaderError(f"{path}: the suffix of a shader says its stage, one of .{', .'.join(STAGES)}.")
    return suffix


def build(
    path: Path,
    backend: Backend,
    *,
    stage: str | None = None,
    roots: Sequence[Path] = (),
    defines: Mapping[str, Constant] | None = None,
    extensions: Sequence[str] = (),
    extensions_with: Mapping[str, str] | None = None,
    snippets: Mapping[str, str] | None = None,
) -> ShaderSource:
    """Return the shader in file `path`, expanded for `backend`; its stage is that of the suffix unless given.

    `defines` become macros: integers and floats with all their digits, bools as 1 and 0, strings as they are.
    `extensions` are required by the text, those of `extensions_with` only where it includes the file of that name;
    files may require more of their own, but not before the first line that is code. Raises ShaderError with the
    place of the include that is missing, part of a cycle, or malformed.
    """
    builder = _Builder(backend, stage or stage_of(path), roots, snippets or {})
    return builder.build_file(path, defines or {}, extensions, extensions_with or {})


def build_text(
    text: str,
    stage: str,
    backend: Backend,
    *,
    name: str = "<text>",
    roots: Sequence[Path] = (),
    defines: Mapping[str, Constant] | None = None,
    extensions: Sequence[str] = (),
    snippets: Mapping[str, str] | None = None,
) -> ShaderSource:
    """Return a shader whose main file is `text`, called `name` in messages; everything else as in `build`."""
    if stage not in STAGES:
        raise ShaderError(f"{name}: there is no shader stage '{stage}', only {', '.join(STAGES)}.")
    builder = _Builder(backend, stage, roots, snippets or {})
    return builder.build(in_memory(name, text), defines or {}, extensions)


def literal(value: Any) -> str:
    """Return a Constant or a scalar of numpy's as GLSL reads it back without loss, or raise ValueError."""
    if isinstance(value, str):
        if "\n" in value:
            raise ValueError("a shader constant is one line of text")
        return value
    if isinstance(value, numbers.Integral):  # bool too: `#if` needs 1 and 0
        number = int(value)
        if not -(2**31) <= number < 2**32:
            raise ValueError(f"the shader constant {number} does not fit 32 bits")
        if number == -(2**31):
            return "(-2147483647 - 1)"  # GLSL has no negative literals, and 2147483648 is no int
        return f"({number})" if number < 0 else f"{number}u" if number >= 2**31 else str(number)
    if isinstance(value, numbers.Real):
        real = float(value)
        if not math.isfinite(real):
            raise ValueError(f"the shader constant {real} is not finite")
        # repr gives the fewest digits that read back as the same double, and its exponent is GLSL's too.
        return f"({real!r})" if math.copysign(1.0, real) < 0 else repr(real)
    raise ValueError(f"a shader constant cannot be a {type(value).__name__}")


# --- expansion ----------------------------------------------------------------------------------------------

_QUOTED = re.compile(r'"([^"]+)"\s*$')
_NAME = re.compile(r"\w*")
_DEFINED = re.compile(r"^#define (\w+)", re.M)
_COMPILERS = re.compile(r"GL_|__|VULKAN$")
"""Macros of the compiler's own."""


@dataclass
class _Group:
    """An open #if: whether its lines are certainly left out, or certainly taken, and whether it included anything."""

    dead: bool = False
    alive: bool = False
    includes: bool = False


class _Builder:
    """State of one expansion."""

    def __init__(
        self, backend: Backend, stage: str, roots: Sequence[Path], snippets: Mapping[str, str]
    ) -> None:
        self.backend, self.stage, self.snippets = backend, stage, snippets
        self.roots = [*roots, SHADERS]
        self.files: list[SourceFile] = []
        self.output: list[str] = []
        self.code: list[str] = []  # the same without what no compiler makes anything of
        self.done: set[str] = set()  # included where no condition can leave them out
        self.guards: dict[str, str] = {}  # included under a condition: the macro that says whether
        self.paths: set[Path] = set()
        self.macros: dict[str, bool] = {}  # that were defined so far: whether they certainly still are

    def build_file(
        self,
        path: Path,
        defines: Mapping[str, Constant],
        extensions: Sequence[str],
        extensions_with: Mapping[str, str],
    ) -> ShaderSource:
        """Return the shader in a file; an error says which files it depends upon."""
        self.paths.add(path)
        try:
            return self.build(load(path), defines, extensions, extensions_with)
        except ShaderError as error:
            error.files |= self.paths
            raise

    def build(
        self,
        main: File,
        defines: Mapping[str, Constant],
        extensions: Sequence[str],
        extensions_with: Mapping[str, str] = MappingProxyType({}),
    ) -> ShaderSource:
        prelude = self._prelude(defines, extensions)
        self.macros = dict.fromkeys(_DEFINED.findall(prelude), True)
        self.files.append(SourceFile("<prelude>", lines_of(prelude)))
        self._expand(main, None, (), 0)
        included = {Path(file.name).name for file in self.files}
        more = [name for file, name in extensions_with.items() if file in included]
        if more:  # now that it is known what is included: they stand before everything else, and define nothing here
            prelude = self._prelude(defines, (*extensions, *more))
            self.files[0] = SourceFile("<prelude>", lines_of(prelude))
        text = prelude + "\n".join(self.output) + "\n"
        placed = "__LINE__" in text or "__FILE__" in text
        code = text if placed else prelude + "\n".join(self.code)
        key = hashlib.sha256(f"{self.stage}\n{code}".encode()).hexdigest()
        return ShaderSource(self.stage, text, tuple(self.files), key, frozenset(self.paths))

    def _prelude(self, defines: Mapping[str, Constant], extensions: Sequence[str]) -> str:
        wanted = list(extensions)
        if self.backend == "gl" and self.stage == "vert":
            wanted.insert(0, "GL_ARB_shader_draw_parameters")  # gl_InstanceID leaves the base instance out
        required = "".join(f"#extension {name} : require\n" for name in dict.fromkeys(wanted))
        lines = []
        for name, value in defines.items():
            if not re.fullmatch(r"[A-Za-z_]\w*", name):
                raise ShaderError(f"'{name}' cannot be the name of a shader constant.")
            try:
                lines.append(f"#define {name} {literal(value)}\n")
            except ValueError as error:
                raise ShaderError(f"{name}: {error}.") from None
        return _PRELUDES[self.backend].format(extensions=required) + "".join(lines)

    def _expand(
        self, file: File, origin: tuple[int, int] | None, above: tuple[File, ...], depth: int
    ) -> None:
        """Append the lines of `file`. `depth` counts the `#if`s around it, `above` are its includers."""
        index = len(self.files)
        self.files.append(SourceFile(file.name, file.lines, origin))
        self.output.append(f"#line 1 {index}")
        groups: list[_Group] = []
        for lines, code, directive, own, number in file.parts:
            dead = any(group.dead for group in groups)
            self.output += lines
            if not dead:
                self.code += code
            if directive is None:
                break
            kind, rest = directive.groups()
            if kind == "include":
                if dead:
                    self.output.append("")
                    continue
                self._include(rest, (index, number), (*above, file), depth + len(groups))
                self.output.append(f"#line {number + 1} {index}")
                for group in groups:
                    group.includes = True
                continue
            if kind == "version":
                raise self._error(
                    (index, number), "the prelude of the backend sets the version; leave this line out"
                )
            self.output.append(file.lines[number - 1])
            self.code.append(own)
            if kind in ("define", "undef"):
                # Under a condition that is unknown here; only the prelude's definitions are certain.
                self.macros[_first_name(rest)] = False
                continue
            if kind.startswith("if"):
                groups.append(self._group(kind, rest))
                continue
            if not groups:
                raise self._error((index, number), "an #if and its #endif must be in the same file")
            if groups[-1].includes:
                # What is left out is counted, and so are the lines that were included there, but not their #line.
                self.output.append(f"#line {number + 1} {index}")
            groups[-1].dead = kind == "else" and groups[-1].alive
            if kind == "endif":
                groups.pop()
        if groups:
            raise self._error((index, len(file.lines)), "an #if and its #endif must be in the same file")

    def _group(self, kind: str, rest: str) -> _Group:
        """Return what an #if begins. What is certainly left out includes nothing: the shader does not use it."""
        name = _first_name(rest)
        if kind == "if" or _COMPILERS.match(name):
            return _Group()
        certain = self.macros.get(name)
        defined = certain is True
        undefined = certain is None
        wanted, unwanted = (defined, undefined) if kind == "ifdef" else (undefined, defined)
        return _Group(dead=unwanted, alive=wanted)

    def _include(self, rest: str, place: tuple[int, int], above: tuple[File, ...], depth: int) -> None:
        quoted = _QUOTED.match(rest.rstrip())
        if not quoted:
            raise self._error(place, 'an include is written #include "name.glsl"')
        file = self._find(quoted[1], above[-1], place)
        if file.identity in [includer.identity for includer in above]:
            first = [includer.identity for includer in above].index(file.identity)
            names = " -> ".join(link.name for link in (*above[first:], file))
            raise self._error(place, f"files include each other in a circle: {names}")
        if file.identity in self.done:
            return
        # Under an #if the compiler may leave the file out, and then a later include of it must count. So
        # "once" is decided there by the compiler, through a macro.
        guard = self.guards.get(file.identity)
        if depth and guard is None:
            guard = self.guards[file.identity] = f"INCLUDED_{len(self.files)}"
        begin, end = ([f"#ifndef {guard}", f"#define {guard}"], ["#endif"]) if guard else ([], [])
        self.output += begin
        self.code += begin
        self._expand(file, place, above, depth)
        self.output += end
        self.code += end
        if not depth:
            self.done.add(file.identity)

    def _find(self, name: str, includer: File, place: tuple[int, int]) -> File:
        if name in self.snippets:
            return in_memory(f"<{name}>", self.snippets[name])
        folders = ([includer.folder] if includer.folder else []) + self.roots
        for folder in folders:
            path = folder / name
            self.paths.add(path)
            if is_there(path):
                return load(path)
        looked = ", ".join(dict.fromkeys(shown_path(folder) for folder in folders))
        raise self._error(place, f"there is no file '{name}' in {looked}")

    def _error(self, place: tuple[int, int], message: str) -> ShaderError:
        return ShaderError(_located(self.files, *place, None, f"error: {message}"))


def _first_name(rest: str) -> str:
    """Return the name at the beginning of what stands behind a directive, "" where there is none."""
    name = _NAME.match(rest)
    assert name is not None, "it takes no letter"
    return name[0]


# --- messages -----------------------------------------------------------------------------------------------

_MESSAGES = (
    re.compile(
        r"(?P<kind>ERROR|WARNING): (?P<file>\d+):(?P<line>\d+):(?:(?P<column>\d+):)? *(?P<text>.*)"
    ),  # glslang
    re.compile(r"(?P<file>\d+):(?P<line>\d+)\((?P<column>\d+)\): (?P<text>.*)"),  # Mesa
    re.compile(r"(?P<file>\d+)\((?P<line>\d+)\) : (?P<text>.*)"),  # NVIDIA
)
_NOISE = re.compile(
    r"ERROR: \d+ compilation errors?\.|.*'' : compilation terminated|SPIR-V is not generated|\s*$"
)


def describe_errors(log: str, source: ShaderSource) -> str:
    """Return a compiler's messages with file, line, the source line with a caret, and the chain of includes.

    Lines of `log` that name no place are kept as they are.
    """
    shown = []
    located = False
    for line in log.splitlines():
        if _NOISE.match(line):
            continue
        place = next((match for pattern in _MESSAGES if (match := pattern.match(line.strip()))), None)
        if place is None or int(place["file"]) >= len(source.files):
            shown.append(line.rstrip().removeprefix("ERROR: "))
            continue
        located = located or place["file"] != "0"  # a place in the prelude does not say which shader it is
        parts = place.groupdict()
        message = f"{parts['kind'].lower()}: {parts['text']}" if parts.get("kind") else parts["text"]
        column = int(parts["column"]) if parts.get("column") else None
        shown.append(_located(source.files, int(place["file"]), int(place["line"]), column, message.strip()))
    text = "\n".join(dict.fromkeys(shown)) or "the compiler refuses this shader and does not say why"
    return text if located else f"{source.name}: {text}"


def _located(files: Sequence[SourceFile], index: int, line: int, column: int | None, message: str) -> str:
    """Return `message` with its place; without a column the caret is below the first word that it quotes."""
    file = files[index]
    parts = [f"{file.name}:{line}: {message}"]
    if 1 <= line <= len(file.lines):
        code = file.lines[line - 1]
        offset = _offset(code, message, column)
        # Tabs stay tabs, so that the caret stands below its character whatever their width.
        padding = "".join("\t" if character == "\t" else " " for character in code[:offset])
        parts += [f"    {code}", f"    {padding}^"]
    while file.included_from is not None:
        index, line = file.included_from
        file = files[index]
        parts.append(f"  included from {file.name}:{line}")
    return "\n".join(parts)


def _offset(code: str, message: str, column: int | None) -> int:
    """Return where the caret goes: to the word that the message quotes, nearest to the column that it names."""
    for word in re.findall(r"['\"`]([^'\"`]+)['\"]", message):
        whole = rf"(?<!\w){re.escape(word)}(?!\w)"
        for pattern in (whole, re.escape(word)):
            places = [match.start() for match in re.finditer(pattern, code)]
            if places:
                return min(places, key=lambda place: abs(place - (column or 1) + 1))
    return min(column - 1, len(code)) if column else len(code) - len(code.lstrip())
