"""By which truth each feature is held and where it is seen to fail: the table oracles.toml, and what is wrong in it.

`faults` reads tests as text, their marks by tools.ledger.features. `unproven` reads what a run of them gave
(tests/support/report.py).
"""

from __future__ import annotations

import ast
import json
import re
import textwrap
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

from common.paths import ROOT
from tools.ledger.features import MarkedTest

TABLE = ROOT / "tests" / "oracles.toml"
PARTS = ("oracle", "held", "negative", "backends")
"""What every entry has."""
BACKENDS = ("vulkan", "gl", "cpu")
SOFTWARE = ("llvmpipe", "lavapipe", "softpipe")
"""A record of such a device stands for no other: it is the one on which the tests run."""


@dataclass(frozen=True)
class Table:
    """The kinds of truth with what counts as one, the entries by slug, why some lack a part of theirs, and why what
    some name has run on no machine that the project tests on."""

    kinds: dict[str, str]
    features: dict[str, dict[str, Any]]
    lacking: dict[str, str] = field(default_factory=dict)
    unshown: dict[str, str] = field(default_factory=dict)


def read(path: Path = TABLE) -> Table:
    """Return the table of a file."""
    found = tomllib.loads(path.read_text("utf-8"))
    return Table(found["kinds"], found["features"], found.get("lacking", {}), found.get("unshown", {}))


# --- what a test says ---

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
    for slug, reason in table.unshown.items():
        if slug not in table.features or "record" in table.features[slug] or len(reason.split()) < 5:
            said.append(
                f"'{slug}' has a record, is no feature, or does not say in a sentence why it is not shown."
            )
    for slug in sorted({*table.features} & {*marked}):
        said += _faults_of(slug, table, marked[slug], root)
    return said


def _faults_of(slug: str, table: Table, tests: tuple[MarkedTest, ...], root: Path) -> Iterator[str]:
    entry, names = table.features[slug], {one.name for one in tests}
    if unknown := entry.keys() - {*PARTS, "record"}:
        yield f"'{slug}' has {', '.join(sorted(unknown))}, which is no part of an entry."
    for part in PARTS:
        if part not in entry and slug not in table.lacking:
            yield f"'{slug}' has no {part}."
    if (kind := entry.get("oracle")) and kind not in table.kinds:
        yield f"'{slug}' is held by '{kind}', which is none of {', '.join(table.kinds)}."
    if (held := entry.get("held")) and held not in names:
        yield f"'{slug}' is held by {held}, which does not bear its mark."
    if negative := entry.get("negative"):
        function = function_of(negative, root)
        if function is None:
            yield f"The negative case of '{slug}', {negative}, is not there."
        elif negative not in names:
            yield f"The negative case of '{slug}', {negative}, does not bear its mark."
        elif not evidence(function):
            yield f"The negative case of '{slug}', {negative}, shows nothing that is refused or that must differ."
    backends = entry.get("backends", [BACKENDS[0]])
    if not backends or backends != [one for one in BACKENDS if one in backends]:
        yield f"'{slug}' names the backends {backends}: they are some of {', '.join(BACKENDS)}, in this order."
    if (record := entry.get("record")) and not devices_of(root / record):
        yield f"'{slug}' has the record {record}, which is not there or names no device but a software driver."


def devices_of(path: Path) -> list[str]:
    """Return the devices that a record of docs/ names, without those that are software; [] if it cannot be read."""
    try:
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
        device = found.get("device", found.get("devices", {}))
        named = (
            [device] if isinstance(device, str) else [one for one in device.values() if isinstance(one, str)]
        )
    except (OSError, ValueError, AttributeError):
        return []
    return named if named and not any(word in one for one in named for word in SOFTWARE) else []


# --- what a run has shown ---


class Ran(Protocol):
    """What became of one test of a run; its `test` is the function's name, the same for all of its parameters."""

    features: tuple[str, ...]
    backends: tuple[str, ...]
    result: str

    @property
    def test(self) -> str: ...


@dataclass(frozen=True)
class Unproven:
    """A sentence on an entry that a run does not bear out; `skipped`: only since the tests were skipped here."""

    sentence: str
    skipped: bool = False


def unproven(table: Table, outcomes: Iterable[Ran], whole: bool) -> list[Unproven]:
    """Return what a run does not bear out of the table.

    The tests of each entry must have passed with some parameters and failed with none. In a `whole` run all of them
    have to be there, and a marked test must have passed on each backend of the entry. In another one only what was
    run counts. What is skipped for want of a device counts as shown where the entry has the record of another, and is
    let through where the table says that nothing shows it.
    """
    by_test: dict[str, set[str]] = defaultdict(set)
    by_backend: dict[tuple[str, str], set[str]] = defaultdict(set)
    for one in outcomes:
        by_test[one.test].add(one.result)
        for slug in one.features:
            for backend in one.backends:  # without its options it is Vulkan still
                by_backend[slug, "vulkan" if backend == "without-all" else backend].add(one.result)
    found: list[Unproven] = []
    for slug, entry in table.features.items():
        excused = "record" in entry or slug in table.unshown
        missing: list[Unproven] = []
        for part, words in (
            ("held", f"'{slug}' is held by"),
            ("negative", f"The negative case of '{slug}' is"),
        ):
            if test := entry.get(part):
                missing += _unproven(f"{words} {test}, which", by_test.get(test, set()), whole)
        for backend in entry.get("backends", ()) if whole else ():
            results = by_backend.get((slug, backend), set())
            if "passed" not in results:
                skipped = results == {"skipped"}
                why = "its tests were skipped there" if skipped else "none passed there"
                missing.append(Unproven(f"'{slug}' needs a marked test on {backend}: {why}.", skipped))
        if whole and slug in table.unshown and not missing:
            found.append(Unproven(f"'{slug}' is shown here: it needs no excuse in the table.", skipped=True))
        found += [one for one in missing if not (excused and one.skipped)]
    return found


def _unproven(test: str, results: set[str], whole: bool) -> list[Unproven]:
    if "failed" in results:
        return [Unproven(f"{test} failed.")]
    if "passed" in results:
        return []
    if results == {"skipped"}:
        return [Unproven(f"{test} was only skipped.", skipped=True)]
    return [Unproven(f"{test} was not run.")] if whole else []
