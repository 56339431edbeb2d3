"""Words of code objects: a pass or a buffer is never "who" or "nobody", and a variable says what it holds.

DESIGN section 12. Benches and exercises are outside, as they are of most rules.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.paths import ROOT

PEOPLE = re.compile(
    r"\b(who|whom|whoever|nobody|somebody|anybody|everybody|someone|anyone|everyone|he|she|him|his)\b", re.I
)
"""`whose` is for things, too."""

EMPTY = {"made", "one", "ones", "found", "given"}
"""Names that say nothing of what a variable holds."""

OUTSIDE = {"benches", "exercises"}
SHADERS = {".glsl", ".vert", ".frag", ".comp"}


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, text) of comments and docstrings; what stands between backticks is code."""
    text = path.read_text("utf-8")
    if path.suffix in SHADERS:
        for number, line in enumerate(text.splitlines(), start=1):
            yield number, line.partition("//")[2]
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield value.lineno, re.sub(r"`[^`]*`", "", value.value)


def names_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, name) of variables and parameters."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        if isinstance(node, ast.arg):
            yield node.lineno, node.arg


def faults_of(path: Path) -> list[str]:
    """Return "line: word" for each word that does not stand for code."""
    faults = [f"{line}: {word[0]}" for line, text in texts_of(path) for word in PEOPLE.finditer(text)]
    if path.suffix == ".py":
        faults += [f"{line}: {name}" for line, name in names_of(path) if name in EMPTY]
    return faults


@pytest.mark.parametrize("top", ["chapters", "common", "backends", "shaders"])
def test_no_code_object_is_a_person_and_names_say_what_they_hold(top: str) -> None:
    files = {
        path.read_bytes(): path  # chapters share most of their files
        for path in (ROOT / top).rglob("*")
        if path.suffix in {".py", *SHADERS} and not OUTSIDE & {*path.relative_to(ROOT).parts}
    }.values()
    assert files
    faults = {path.relative_to(ROOT).as_posix(): faults_of(path) for path in files}
    assert {path: found for path, found in faults.items() if found} == {}


def test_such_words_are_found(tmp_path: Path) -> None:
    python, shader = tmp_path / "a.py", tmp_path / "b.frag"
    python.write_text(
        '"""Nobody waits; `who` is a name."""\n\ndef f(given):\n    one = 1  # who reads this\n'
    )
    shader.write_text("float x;  // nobody reads it\n")
    assert faults_of(python) == ["4: who", "1: Nobody", "3: given", "4: one"]
    assert faults_of(shader) == ["1: nobody"]
