"""What of a chapter a file of tests depends on, as a digest: equal digests of two chapters make equal tests.

A file depends on the chapter's modules that it imports, on those that they import in turn, and on all shaders as soon
as one of these modules names a shader. A file that asks for the fixture `chapter` depends on the whole chapter. What a
chapter says about itself (its own `__init__.py`) counts only where a module imports it, as renderers do.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SHADERS = (".vert", ".tesc", ".tese", ".geom", ".task", ".mesh", ".frag", ".comp", ".glsl")
STAR = ("studies", "benches")
"""The folders of a chapter that later chapters do not have: what a test imports of them is always the chapter's own."""

NOT_DRAWN = ("README.md", "__pycache__", *STAR)
"""What of a chapter's folder takes no part in its pictures."""


@cache
def syntax(path: Path) -> ast.Module:
    """Return the syntax tree of a file; it is kept, so nobody may change it."""
    return ast.parse(path.read_bytes(), filename=str(path))


@cache
def digest(test: Path, package: str, folder: Path) -> str:
    """Return the digest of what `test` depends on of a chapter, but for what is the same for each (`STAR`).

    `package` is the name by which the test imports the chapter it was written for ("chapters.ch01"), `folder` holds the
    chapter that is looked at.
    """
    names = (name for name in _imported(test, package) if name[0] not in STAR)
    used = everything(folder) if _asks_for_chapter(test) else _closure(names, folder)
    found = hashlib.sha256()
    for path in sorted(used):
        found.update(f"{path.relative_to(folder).as_posix()}\0{_content(path)}\0".encode())
    return found.hexdigest()


@cache
def _content(path: Path) -> str:
    """Return the digest of one file, which many tests depend on."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def everything(folder: Path) -> frozenset[Path]:
    """Return all files of a chapter that its pictures depend on."""
    return frozenset(
        path
        for path in folder.rglob("*")
        if path.is_file() and not set(path.relative_to(folder).parts) & set(NOT_DRAWN)
    )


def _asks_for_chapter(test: Path) -> bool:
    return any(isinstance(node, ast.arg) and node.arg == "chapter" for node in ast.walk(syntax(test)))


def _imported(test: Path, package: str) -> Iterator[tuple[str, ...]]:
    """Yield the dotted names below `package` that a file of tests names, in imports and in texts of programs."""
    named = re.compile(rf"\b{re.escape(package)}((?:\.\w+)+)")
    parent, _, last = package.rpartition(".")
    for node in ast.walk(syntax(test)):
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            if node.module == package or node.module.startswith(package + "."):
                below = tuple(node.module[len(package) :].split(".")[1:])
                yield from ((*below, alias.name) for alias in node.names)
            elif node.module == parent and any(alias.name == last for alias in node.names):
                yield ("*",)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith(package + "."):
                    yield tuple(alias.name[len(package) + 1 :].split("."))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from (tuple(match[1].split(".")[1:]) for match in named.finditer(node.value))


def _closure(names: Iterator[tuple[str, ...]], folder: Path) -> frozenset[Path]:
    """Return the files behind dotted names below a chapter, and what their relative imports lead to."""
    found: set[Path] = set()
    waiting = [path for name in names for path in _files(name, folder)]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        waiting += _needs(path, folder)
    return frozenset(found)


def _files(name: tuple[str, ...], folder: Path) -> Iterator[Path]:
    """Yield the module that a dotted name is or is in, and the `__init__.py` of the packages around it."""
    if name == ("*",):
        yield from everything(folder)
        return
    place = folder
    for part in name:
        if (place / part).is_dir():
            place /= part
            if (place / "__init__.py").is_file():
                yield place / "__init__.py"
            continue
        if (place / f"{part}.py").is_file():
            yield place / f"{part}.py"
        elif place == folder and (place / "__init__.py").is_file():
            yield place / "__init__.py"  # what the chapter says about itself
        return


def _names_shaders(node: ast.AST) -> bool:
    """Whether a module builds shaders: it names one, or it calls what puts their text together."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, str) and node.value.endswith(SHADERS)
    return isinstance(node, ast.ImportFrom) and any(one.name == "shader_text" for one in node.names)


@cache
def _needs(path: Path, folder: Path) -> frozenset[Path]:
    """Return the files of its chapter that one module needs itself."""
    found: set[Path] = set()
    if path.suffix != ".py":
        return frozenset()
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1]
            if base != folder and folder not in base.parents:
                continue
            inside = base.relative_to(folder).parts + tuple(
                (node.module or "").split(".") if node.module else ()
            )
            for alias in node.names:
                found |= {*_files((*inside, alias.name), folder)}
        if _names_shaders(node):
            found |= {shader for shader in everything(folder) if shader.suffix in SHADERS}
    return frozenset(found)
