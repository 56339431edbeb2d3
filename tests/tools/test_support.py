"""What tests share, and what chapters share, names no chapter: a test for a later chapter would test another one."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.paths import ROOT

SHARED = ("tests/support", "common", "backends")
CHAPTER = re.compile(r"\bch\d\d\b|\bchapters\.ch|\bchapters/ch\d")
BY_NUMBER = {
    *("open", "lesson", "package_of", "folder_of", "folder_name", "title_of"),
    *("renderer_module", "settings_class", "outputs_of", "choose_backend", "decide_backend"),
}
"""Functions of `chapters` that take the number of one."""


def chapters_named(text: str) -> list[str]:
    """Return what a module names of single chapters: in imports, attributes, texts, and as a number for `chapters`.

    Texts that stand alone, such as docstrings, may name chapters as examples.
    """
    tree = ast.parse(text)
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    return [name for node in ast.walk(tree) if id(node) not in alone for name in _named(node)]


def _named(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.Import(names=names):
            yield from (alias.name for alias in names if CHAPTER.search(alias.name))
        case ast.ImportFrom(module=module, names=names):
            paths = [f"{module}.{alias.name}" for alias in names]
            yield from (path for path in paths if CHAPTER.search(path))
        case ast.Attribute(attr=name) if CHAPTER.fullmatch(name):
            yield name
        case ast.Constant(value=str(words)) if CHAPTER.search(words):
            yield words
        case ast.Call(func=ast.Attribute(value=ast.Name(id="chapters"), attr=function), args=[first, *_]):
            if function in BY_NUMBER and isinstance(first, ast.Constant) and isinstance(first.value, int):
                yield f"chapters.{function}({first.value})"


@pytest.mark.parametrize("folder", SHARED)
def test_what_is_shared_names_no_chapter(folder):
    paths = [path for path in (ROOT / folder).rglob("*.py") if "__pycache__" not in path.parts]
    found = {path.relative_to(ROOT).as_posix(): chapters_named(path.read_text("utf-8")) for path in paths}
    assert {name: names for name, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("from chapters.ch05.graph.types import Node", "chapters.ch05.graph.types.Node"),
        ("from chapters import ch05", "chapters.ch05"),
        ("def late():\n    import chapters.ch02.settings", "chapters.ch02.settings"),
        ("node = chapters.ch04.graph", "ch04"),
        ("part = import_module('chapters.ch05.graph')", "chapters.ch05.graph"),
        ("part = import_module(f'chapters.ch{number:02d}')", "chapters.ch"),
        ("part = import_module('.ch05', 'chapters')", ".ch05"),
        ("path = ROOT / 'chapters/ch01/shading'", "chapters/ch01/shading"),
        ("renderer = chapters.open(5, scene=scene)", "chapters.open(5)"),
    ],
)
def test_a_chapter_is_found_however_it_is_named(text, name):
    assert chapters_named(text) == [name]


def test_what_is_given_and_what_is_explained_is_no_name():
    text = '"""As in tests/ch01/test_x.py."""\nimport chapters\nopened = chapters.open(number)\narch = "arch01"\n'
    assert chapters_named(text) == []


def test_the_folders_are_there():
    assert all(any(Path(ROOT, folder).rglob("*.py")) for folder in SHARED)
