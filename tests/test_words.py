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
SHADERS = {".glsl", ".vert", ".tesc", ".tese", ".geom", ".task", ".mesh", ".frag", ".comp"}


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


# --- lessons ----------------------------------------------------------------------------------------------------------

PLAIN = ("ch01", "ch02", "ch03", "ch04", "ch05", "ch06", "ch08", "ch09", "ch10", "ch11", "ch12")
"""Chapters whose README is in plain technical English already."""

MEAN_WORDS = 16.0
LONG = 28
MOST_LONG = 0.05
"""DESIGN section 12 in numbers: words of a sentence on average, and how many sentences may have more than `LONG`."""


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a Markdown text: no headings, tables, code or pictures; code in a sentence is a word."""
    text = re.sub(r"```.*?```", "\n\n", text, flags=re.DOTALL)
    sentences = []
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[-*|#]|\d+\.)\s)", text):
        block = block.strip()
        if not block or block.startswith(("|", "#", "![")):
            continue
        block = re.sub(r"`[^`]*`", "x", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", block))
        block = re.sub(r"^(?:[-*]|\d+\.)\s+", "", block).replace("*", "").replace("_", "")
        sentences += re.split(r"(?<=[.!?])[\")]*\s+(?=[\"(]?[A-Z0-9x])", " ".join(block.split()))
    return [sentence for sentence in sentences if re.search(r"\w", sentence)]


def words_in(sentence: str) -> int:
    return sum(1 for word in sentence.split() if re.search(r"\w", word))


@pytest.mark.parametrize("chapter", PLAIN)
def test_a_lesson_has_short_sentences_and_no_code_object_is_a_person(chapter: str) -> None:
    text = (ROOT / "chapters" / chapter / "README.md").read_text("utf-8")
    sentences = sentences_of(text)
    counts = [words_in(sentence) for sentence in sentences]
    long = [sentence for sentence, words in zip(sentences, counts, strict=True) if words > LONG]
    assert len(sentences) > 100 and sum(counts) <= MEAN_WORDS * len(counts)
    assert len(long) <= MOST_LONG * len(counts), "\n".join(long)
    assert [sentence for sentence in sentences if PEOPLE.search(sentence)] == []


def test_sentences_are_counted_without_code_tables_and_pictures() -> None:
    text = """# A title of five words here

![A picture. With words.](a.png)

The [barrier](a.py) waits for `one. two`. It has **two** stages.

```
not. a. sentence.
```

- A list has sentences. Each counts (this, too).
1. So does this.

| a | table. |
|---|---|
"""
    assert [(words_in(sentence), sentence) for sentence in sentences_of(text)] == [
        (5, "The barrier waits for x."),
        (4, "It has two stages."),
        (4, "A list has sentences."),
        (4, "Each counts (this, too)."),
        (3, "So does this."),
    ]
