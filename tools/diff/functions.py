"""Which function, class or constant a line belongs to: Python by its syntax tree, GLSL by a scan for heads and braces.

A scan is enough for GLSL: its functions cannot nest, and a preprocessor's branch that opens a brace closes it.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

from tools.diff.files import Source


@dataclass(frozen=True)
class Definition:
    """A named part of a file: "Renderer.render", what it is, and its first and last line, counted from 1."""

    name: str
    kind: str
    first: int
    last: int


@dataclass(frozen=True)
class Outline:
    """The definitions of a file in its order, and the lines that only import.

    `problem` says why there are none, where the file cannot be parsed.
    """

    definitions: tuple[Definition, ...] = ()
    imports: frozenset[int] = frozenset()
    problem: str = ""

    def owners(self, count: int) -> list[str]:
        """Return for lines 0 to `count` the innermost definition that holds each, "" for none; there is no line 0."""
        names = [""] * (count + 1)
        for one in self.definitions:  # an inner one comes after the one around it
            for line in range(one.first, min(one.last, count) + 1):
                names[line] = one.name
        return names


def outline(source: Source) -> Outline:
    """Return what a file defines; of a text that is neither Python nor GLSL, nothing."""
    if source.text is None or not source.is_code:
        return Outline()
    return _python(source.text) if source.suffix == ".py" else _glsl(source.text)


def _python(text: str) -> Outline:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # an escape that Python will refuse one day is the reader's to find
            tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        where = f" (line {error.lineno}: {error.msg})" if isinstance(error, SyntaxError) else ""
        return Outline(problem=f"it cannot be parsed as Python{where}, so its functions are not named")
    imports = {
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    return Outline(tuple(_definitions(tree, "")), frozenset(imports))


def _definitions(node: ast.AST, within: str) -> Iterator[Definition]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            name = f"{within}.{child.name}" if within else child.name
            kind = "function"
            if isinstance(child, ast.ClassDef):
                kind = "class"
            elif isinstance(node, ast.ClassDef):
                kind = "method"
            first = min([child.lineno, *(decorator.lineno for decorator in child.decorator_list)])
            yield Definition(name, kind, first, child.end_lineno or child.lineno)
            if kind == "class":  # a function inside a function is a part of it
                yield from _definitions(child, name)
        elif isinstance(node, ast.Module) and isinstance(child, ast.Assign | ast.AnnAssign):
            targets = child.targets if isinstance(child, ast.Assign) else [child.target]
            names = [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
            if names:
                yield Definition(", ".join(names), "constant", child.lineno, child.end_lineno or child.lineno)
        elif isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case):
            yield from _definitions(child, within)  # what stands behind an `if` or a `try`


_COMMENT = re.compile(r'//[^\n]*|/\*.*?\*/|"[^"\n]*"', re.S)
_INCLUDE = re.compile(r"^[ \t]*#[ \t]*include\b[^\n]*", re.M)
_HEAD = re.compile(
    r"\bstruct\s+(?P<struct>\w+)\s*\{"
    r"|\b(?:uniform|buffer|in|out|shared|taskPayloadSharedEXT)\s+(?P<block>\w+)\s*\{"
    r"|\b[A-Za-z_]\w*(?:\s*\[\s*\w*\s*\])?\s+(?P<function>[A-Za-z_]\w*)\s*\([^(){};]*\)\s*\{"
)


def _glsl(text: str) -> Outline:
    plain = _COMMENT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    imports = frozenset(plain.count("\n", 0, match.start()) + 1 for match in _INCLUDE.finditer(plain))
    found, place = [], 0
    while match := _HEAD.search(plain, place):
        kind = match.lastgroup or ""
        depth, place = 1, match.end()
        while depth and (brace := re.compile(r"[{}]").search(plain, place)):
            depth += 1 if brace[0] == "{" else -1
            place = brace.end()
        first, last = (plain.count("\n", 0, at) + 1 for at in (match.start(), place))
        found.append(Definition(match[kind], kind, first, last))
    return Outline(tuple(found), imports)
