"""A fork as the commands take it: a folder anywhere on disk with a copy of a chapter, imported as a package of its own.

    ./strata run my-ch03
    ./strata compare 3 ../elsewhere/my-ch03
    chapters.open(Path("my-ch03"), scene=scene)

Its files import each other relatively, as those of a chapter do, and `common` and `backends` by name. Two forks in one
process are two packages; a fork that was edited is read anew by the next process.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import chapters
from common.errors import UserError
from common.lessons import Lesson
from common.names import suggest

NEEDED = ("__init__.py", "renderer.py")
RECORD = "fork.json"
FORMAT = 2
"""Of `fork.json`. It changes when files or modules that a fork names move: then an older fork cannot be imported."""
_CHAPTER = re.compile(r"(?:ch)?\d+(?:/.*)?", re.ASCII | re.IGNORECASE)
"""What is a chapter or a study whatever folders there are: "3", "ch03", "3/first-triangle"."""


@dataclass(frozen=True)
class Folder:
    """A folder with a copy of a chapter; `path` is absolute, without links, `text` how the user named it."""

    path: Path
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        """The folder as the user named it."""
        return self.text or str(self.path)

    @property
    def spoken(self) -> str:
        """How it is called in a sentence: as the user named it, or by its name where that was "." or ".."."""
        return self.path.name if Path(str(self)).name in ("", "..") else str(self)

    @property
    def package(self) -> str:
        """The name of the package that the folder is imported as; raises what its `__init__.py` raises."""
        short = f"fork_{hashlib.sha256(str(self.path).encode()).hexdigest()[:12]}"
        name = f"chapters.{short}"
        if name not in sys.modules:
            importlib.invalidate_caches()  # a file may have come since Python looked into the folder
            spec = importlib.util.spec_from_file_location(
                name, self.path / "__init__.py", submodule_search_locations=[str(self.path)]
            )
            assert spec is not None and spec.loader is not None
            module = sys.modules[name] = importlib.util.module_from_spec(spec)
            try:
                spec.loader.exec_module(module)
            except BaseException:
                del sys.modules[name]
                raise
            setattr(chapters, short, module)
        return name

    @property
    def lesson(self) -> Lesson:
        """What its chapter says about itself; raises UserError where that is gone."""
        lesson = getattr(sys.modules[self.package], "LESSON", None)
        if not isinstance(lesson, Lesson):
            raise UserError(
                f"{self.path / '__init__.py'} has no LESSON: a copy of a chapter keeps that of the chapter, "
                "with its number."
            )
        return lesson

    @property
    def file_name(self) -> str:
        """How the names of files about it begin."""
        return re.sub(r"[^\w.-]+", "-", self.path.name).strip("-.") or "fork"

    def state(self) -> str:
        """Return a digest that is another one after any file of it was saved."""
        files = sorted(path for path in self.path.rglob("*") if path.suffix != ".pyc" and path.is_file())
        parts = (f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in files)
        return hashlib.sha256("\n".join([str(self.path), *parts]).encode()).hexdigest()


def renderer_name(folder: Path, backend: str) -> str:
    """Return the name of the module of a chapter's folder with its renderer on "vulkan" or "gl", "" if there is none.

    Chapters 1 to 3 tell the frame once for each API, in `renderer.py` and `gl_renderer.py`. From chapter 4 on it is
    told once, and `gl.py` opens it on OpenGL.
    """
    names = ("renderer",) if backend == "vulkan" else ("gl_renderer", "gl")
    return next((name for name in names if (folder / f"{name}.py").is_file()), "")


def typed(folder: Path) -> str:
    """Return how commands are to name a folder: "./3" for a folder whose name a chapter has, too."""
    return f"./{folder}" if _CHAPTER.fullmatch(str(folder)) else str(folder)


def path_of(text: object) -> Path | None:
    """Return the path that a path or a text with a separator names; None for a word, a number or "3/first-triangle"."""
    if isinstance(text, Path):
        return text.expanduser()
    if not isinstance(text, str) or _CHAPTER.fullmatch(text):
        return None
    return Path(text).expanduser() if "/" in text or os.sep in text else None


def named(text: str) -> Folder | int | None:
    """Return the fork, or the chapter, whose folder `text` names; None where it names none.

    "3", "ch03" and "3/first-triangle" are never folders: one of such a name is reached by "./3". Raises UserError for
    a folder that is not there or holds no chapter.
    """
    if _CHAPTER.fullmatch(text):
        return None
    path = path_of(text)
    if path is not None:
        return read(path, text)
    return read(Path(text).expanduser(), text) if Path(text).expanduser().is_dir() else None


def is_copy(path: Path) -> bool:
    """Whether a folder holds a chapter or a copy of one."""
    return all((path / name).is_file() for name in NEEDED)


def beside() -> list[str]:
    """Return the names of the folders here that look like forks."""
    try:
        names = [path.parent.name for path in Path().glob(f"*/{NEEDED[-1]}")]
        return [name for name in names if not name.startswith(".")]
    except OSError:
        return []  # the current folder cannot be read, or is gone


def read(path: Path, text: str = "") -> Folder | int:
    """Return the fork in a folder, or the number of the chapter that the folder is.

    Raises UserError where there is no such folder, or no chapter in it.
    """
    text = text or str(path)
    place = path.expanduser().resolve()
    if place.is_file():
        raise UserError(f"{text} is a file: name the folder that holds the copy of a chapter.")
    if not place.is_dir():
        beside = (
            [path.name for path in place.parent.iterdir() if path.is_dir()] if place.parent.is_dir() else []
        )
        near = suggest(place.name, beside)
        raise UserError(f"There is no folder {text}{near if near.endswith('?') else '.'}")
    for number in chapters.available():
        if place == (chapters.FOLDER / chapters.folder_name(number)).resolve():
            return number
    missing = [name for name in NEEDED if not (place / name).is_file()]
    if missing:
        raise UserError(f"{text} holds no copy of a chapter: it has no {' and no '.join(missing)}.")
    check_format(place, text)
    return Folder(place, text)


def check_format(place: Path, text: str) -> None:
    """Raise UserError if the fork in `place`, which the user calls `text`, was made before files of the project moved.

    A folder without a record is a copy made by hand: what it lacks is said when it is imported.
    """
    try:
        record = json.loads((place / RECORD).read_text("utf-8"))
        format_, commit = record["format"], record["commit"]
    except (OSError, ValueError, KeyError, TypeError):
        return  # `strata fork --update` says what is wrong with the record
    origin = f"{text} was forked from commit {commit or 'unknown'} of Strata"
    if format_ == 1:
        raise UserError(
            f"{origin}, and files that it imports have moved since: draw with it in a clone of that commit, or make "
            "a new fork and put your changes into it."
        )
    if format_ != FORMAT:
        raise UserError(f"{origin}, which is newer than this one: update this clone.")
