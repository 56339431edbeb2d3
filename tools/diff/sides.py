"""What `strata diff` compares: the texts of its two sides, read as a chapter or a folder with a copy of one.

3           a chapter, whole
3@gl        its OpenGL version; beside a side that is not, each of its files stands beside its twin on Vulkan
my-ch03     a folder anywhere on disk that holds a chapter's files, also with @gl
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import chapters
from chapters.folders import renderer_name
from common.errors import UnsupportedError, UserError
from common.names import suggest
from tools.diff.files import Source, sources

BACKENDS = {"": "", "vulkan": " on Vulkan", "gl": " on OpenGL"}
OPENGL = re.compile(r"(.*/)?gl(_\w+)?\.py")
VULKAN = re.compile(r"(.*/)?vulkan(_\w+)?\.py|renderer\.py")
"""Files of what a chapter does in another way with OpenGL than with Vulkan."""


@dataclass(frozen=True)
class Side:
    """A chapter or a copy of one. `number` and `reading` are what its LESSON says, None and () where it is unreadable.

    `backend` is "gl", "vulkan", or "" for the whole chapter; `own` says that it is one of the project's chapters.
    """

    text: str
    folder: Path
    own: bool
    number: int | None
    title: str
    reading: tuple[str, ...]
    backend: str = ""

    @property
    def name(self) -> str:
        """What it is called in a sentence: "chapter 3 on OpenGL", "my-ch03"."""
        return (f"chapter {self.number}" if self.own else self.text) + BACKENDS[self.backend]


def tree_of(text: str) -> Side:
    """Return the side that `text` means; raise UserError if there is neither such a chapter nor such a folder."""
    if Path(text).is_dir() and text.strip():
        name, backend = text, ""
    else:
        name, at, backend = text.rpartition("@")
        if not at:
            name, backend = text, ""
        elif backend not in ("gl", "vulkan"):
            near = suggest(backend, ("gl", "vulkan"))
            raise UserError(
                f"{text}: there is no backend {backend!r}{near}{'' if near.endswith('?') else '.'}"
            )
    side = (
        _chapter(name, backend)
        if re.fullmatch(r"(ch)?\d+", name, re.ASCII | re.I)
        else _folder(name, backend)
    )
    if backend == "gl" and not renderer_name(side.folder, "gl"):
        raise UnsupportedError(
            f"{text}: {name} has no OpenGL version, since gl_renderer.py and gl.py are missing there."
        )
    return side


def _chapter(name: str, backend: str) -> Side:
    chapters.parse_chapter(name)  # which says so if there is none
    number = int(name.lower().removeprefix("ch"))
    lesson = chapters.lesson(number)
    folder = chapters.FOLDER / chapters.folder_name(number)
    return Side(str(number), folder, True, number, lesson.title, tuple(lesson.reading), backend)


def _folder(name: str, backend: str) -> Side:
    folder = Path(name).expanduser()
    if not name.strip() or not folder.is_dir():
        if re.match(r"(ch)?\d+/", name, re.ASCII | re.I) and not folder.exists():
            chapters.parse_chapter(name)  # which says that it is a study, or that there is none such
        raise UserError(_missing(name, folder))
    if not (folder / "renderer.py").is_file():
        raise UserError(
            f"{name} holds no chapter: there is no renderer.py in it; name a copy of a chapter's whole folder."
        )
    lesson = _lesson_in(folder / "__init__.py")
    number, reading = lesson.get("number"), lesson.get("reading", ())
    return Side(
        folder.name if folder.is_absolute() else name.rstrip("/\\") or name,
        folder,
        False,
        number if isinstance(number, int) else None,
        str(lesson.get("title", "")),
        tuple(str(each) for each in reading) if isinstance(reading, tuple | list) else (),
        backend,
    )


def _missing(name: str, folder: Path) -> str:
    """Return the sentence for a side that is no folder and no number."""
    if name.strip() and folder.exists():
        return f"{name} is a file: name a chapter, as 1, or the folder of a copy of one."
    siblings = folder.parent.iterdir() if name.strip() and folder.parent.is_dir() else ()
    known = [str(path.relative_to(folder.parent)) for path in siblings if (path / "renderer.py").is_file()]
    near = suggest(folder.name, known) if known else ""
    if near.endswith("?"):
        return f"There is no chapter or folder {name!r}{near}"
    there = ", ".join(str(number) for number in chapters.available())
    return (
        f"There is no chapter or folder {name!r}: chapters are {there}, and a folder must hold a copy of one."
    )


def _lesson_in(path: Path) -> dict[str, Any]:
    """Return what is written out in the LESSON of an `__init__.py`, without running it: a copy may be broken."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return {}
    found: dict[str, Any] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.Call):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(isinstance(target, ast.Name) and target.id == "LESSON" for target in targets):
                for keyword in node.value.keywords:
                    try:
                        found[keyword.arg or ""] = ast.literal_eval(keyword.value)
                    except ValueError:  # computed there, and so not known here
                        continue
    return found


def are_versions(a: Side, b: Side) -> bool:
    """Whether the sides are a Vulkan and an OpenGL version, whose files are pairs of another name."""
    return (a.backend == "gl") != (b.backend == "gl")


def files_of(side: Side, versions: bool) -> dict[str, Source]:
    """Return the files that a side brings, by the key under which the other side has its twin. Raises OSError."""
    found = sources(side.folder)
    if versions and side.backend == "gl":
        return {twin(path, [*found]): found[path] for path in found if OPENGL.fullmatch(path)}
    if versions:
        return {path: source for path, source in found.items() if VULKAN.fullmatch(path)}
    if side.backend == "gl":
        return {path: source for path, source in found.items() if OPENGL.fullmatch(path)}
    if side.backend == "vulkan":
        return {path: source for path, source in found.items() if not OPENGL.fullmatch(path)}
    return found


def twin(path: str, known: Sequence[str]) -> str:
    """Return the file on Vulkan that does what `path`, "a/gl_x.py", does on OpenGL, or `path` where there is none."""
    folder, _, name = path.rpartition("/")
    other = (
        "renderer.py" if path in ("gl_renderer.py", "gl.py") else f"{folder}/vulkan{name.removeprefix('gl')}"
    )
    return other if other in known else path
