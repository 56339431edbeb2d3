"""By which truth each feature is held and where it is seen to fail: the table oracles.toml, and what is wrong in it.

Nothing is imported and nothing is run: tests are read as text, their marks by chapters.features.
"""

from __future__ import annotations

import ast
import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path

from chapters.features import MarkedTest
from common.paths import ROOT

TABLE = ROOT / "tests" / "oracles.toml"
HOMES = ("assets", "backends", "bootstrap", "chapters", "common", "shaders")
"""Imports from here say what a file of tests is about."""


@dataclass(frozen=True)
class Table:
    """The kinds of truth with what counts as one, the entries by slug, and why some lack a part of theirs."""

    kinds: dict[str, str]
    features: dict[str, dict[str, str]]
    lacking: dict[str, str] = field(default_factory=dict)


def read(path: Path = TABLE) -> Table:
    """Return the table of a file."""
    found = tomllib.loads(path.read_text("utf-8"))
    return Table(found["kinds"], found["features"], found.get("lacking", {}))


# --- what a test says ---

_IMPORT = re.compile(r"^ *(?:from ([\w.]+) )?import (\(.*?\)|[^\n]+)", re.MULTILINE | re.DOTALL)
_NEXT = re.compile(r"^(?:@|def |class |[A-Za-z_#])", re.MULTILINE)


@cache
def _text(name: str, root: Path) -> str:
    try:
        return (root / name).read_text("utf-8")
    except OSError:
        return ""


def function_of(name: str, root: Path = ROOT) -> ast.FunctionDef | None:
    """Return the function "tests/area/test_x.py::test_y"; None where it is not there.

    Of a file no more is parsed than that function: most of the time that this takes is parsing.
    """
    file, _, function = name.partition("::")
    text = _text(file, root)
    begin = re.search(rf"^( *)def {re.escape(function)}\(", text, re.MULTILINE)
    if not function.startswith("test_") or begin is None:
        return None
    end = _NEXT.search(text, begin.end())
    part = text[begin.start() : end.start() if end and not begin[1] else len(text)]
    try:
        tree: ast.AST = ast.parse(textwrap.dedent(part))
    except SyntaxError:  # of a class, or a text in it begins a line
        tree = ast.parse(text)
    return next(one for one in ast.walk(tree) if isinstance(one, ast.FunctionDef) and one.name == function)


@cache
def modules(name: str, root: Path = ROOT) -> frozenset[str]:
    """Return what a file of tests imports from the project, module by module or name by name: what it is about."""
    found = set()
    for module, names in _IMPORT.findall(_text(name, root)):
        words = [one.split()[0] for one in names.split("#")[0].strip("()").split(",") if one.strip()]
        found |= {f"{module}.{one}" for one in words} if module else set(words)
        found |= {module} if "." in module else set()
    return frozenset(one for one in found if one.split(".")[0] in HOMES)


def evidence(function: ast.FunctionDef) -> str:
    """Return by what a test shows a refusal or a difference, "" if it shows none: its own asserts are looked at alone.

    An error that is expected; an exit code other than 0; something that must differ, be larger than a bound, not be
    the case, be among what is found; or nothing, where something would have come if it were not refused.
    """
    for node in ast.walk(function):
        if isinstance(node, ast.Attribute) and node.attr in ("raises", "warns"):
            return "an error that is expected"
    for one in ast.walk(function):
        for node in ast.walk(one.test) if isinstance(one, ast.Assert) else ():
            if found := _shows(node):
                return found
    return ""


def _shows(node: ast.AST) -> str:
    match node:
        case ast.UnaryOp(op=ast.Not(), operand=operand) if not isinstance(operand, ast.Name):
            return "what must not be the case"
        case ast.Call(func=ast.Name(id="any")):
            return "what must be found"
        case ast.Compare():
            sides = [node.left, *node.comparators]
            for operator, (left, right) in zip(node.ops, pairwise(sides), strict=True):
                if found := _compares(operator, left, right):
                    return found
    return ""


def _compares(operator: ast.cmpop, left: ast.expr, right: ast.expr) -> str:
    if isinstance(operator, (ast.NotEq, ast.NotIn, ast.IsNot)):
        return "what must differ"
    if isinstance(operator, (ast.Gt, ast.GtE)) or (
        isinstance(operator, (ast.Lt, ast.LtE)) and isinstance(left, ast.Constant) and bool(left.value)
    ):
        return "a difference beyond a bound"
    if isinstance(operator, (ast.Eq, ast.Is)):
        if ast.unparse(right) in ("[]", "()", "{}", "''", "None", "False"):
            return "nothing where something was asked for"
        pairs = zip(left.elts, right.elts, strict=False) if _tuples(left, right) else ((left, right),)  # type: ignore[attr-defined]
        for what, value in pairs:
            if (
                "code" in ast.unparse(what)
                and isinstance(value, ast.Constant)
                and value.value not in (0, None)
            ):
                return "an exit code other than 0"
    return ""


def _tuples(*nodes: ast.expr) -> bool:
    return all(isinstance(node, ast.Tuple) for node in nodes)


# --- what is wrong ---


def faults(table: Table, marked: Mapping[str, tuple[MarkedTest, ...]], root: Path = ROOT) -> list[str]:
    """Return what is wrong in the table, a sentence each; `marked` are the tests of each feature."""
    said = [
        f"The table has '{slug}', and no test bears that mark."
        for slug in sorted({*table.features} - {*marked})
    ]
    said += [
        f"'{slug}' has tests and no entry in the table." for slug in sorted({*marked} - {*table.features})
    ]
    said += [f"'{one}' stands behind '{before}': entries are sorted." for before, one in pairwise(table.features)
             if one < before]  # fmt: skip
    used = {entry.get("oracle") for entry in table.features.values()}
    said += [
        f"No feature is held by '{kind}': leave that kind out." for kind in table.kinds if kind not in used
    ]
    for slug, reason in table.lacking.items():
        entry = table.features.get(slug, {})
        if {"oracle", "held", "negative"} <= entry.keys() or len(reason.split()) < 5:
            said.append(f"'{slug}' is lacking nothing, or does not say in a sentence what.")
    for slug in sorted({*table.features} & {*marked}):
        said += _faults_of(slug, table, marked[slug], root)
    return said


def _faults_of(slug: str, table: Table, tests: tuple[MarkedTest, ...], root: Path) -> Iterator[str]:
    entry = table.features[slug]
    if unknown := entry.keys() - {"oracle", "held", "negative"}:
        yield f"'{slug}' has {', '.join(sorted(unknown))}, which is no part of an entry."
    for part in ("oracle", "held", "negative"):
        if part not in entry and slug not in table.lacking:
            yield f"'{slug}' has no {part}."
    if (kind := entry.get("oracle")) and kind not in table.kinds:
        yield f"'{slug}' is held by '{kind}', which is none of {', '.join(table.kinds)}."
    if (held := entry.get("held")) and held not in {one.name for one in tests}:
        yield f"'{slug}' is held by {held}, which does not bear its mark."
    if negative := entry.get("negative"):
        function = function_of(negative, root)
        if function is None:
            yield f"The negative case of '{slug}', {negative}, is not there."
        elif not _beside(negative.partition("::")[0], {one.name.partition("::")[0] for one in tests}, root):
            yield f"The negative case of '{slug}', {negative}, lies in a file that is not about it."
        elif not evidence(function):
            yield f"The negative case of '{slug}', {negative}, shows nothing that is refused or that must differ."


def _beside(file: str, files: set[str], root: Path) -> bool:
    """Whether a file has tests of a feature, or lies beside one that has and is about the same module."""
    beside = (one for one in files if Path(one).parent == Path(file).parent)
    return file in files or any(modules(one, root) & modules(file, root) for one in beside)
