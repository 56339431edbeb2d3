"""The studies of the chapters: finding them by name, "1/first-triangle", and what the command line asks of them.

A fork that was made with studies has them too: "my-ch01/first-triangle", or the study's folder,
"my-ch01/studies/first_triangle".
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import chapters
from chapters import folders
from common.errors import UnsupportedError, UserError
from common.lessons import OWN, Study
from common.names import suggest

if TYPE_CHECKING:
    from chapters import Which, Whole
    from common.gltf.load import Progress
    from common.scene import Scene

FILES = {"vulkan": "vulkan.py", "gl": "gl.py"}
"""The file of a study's renderer on each backend."""


def folder(owner: Whole) -> Path:
    """Return the folder of the studies of a chapter or a fork."""
    return chapters.folder_of(owner) / "studies"


@cache
def available(owner: Whole) -> dict[str, Study]:
    """Return the studies of a chapter or a fork by name, in the order in which they are meant to be read."""
    studies = {}
    for path in sorted(folder(owner).glob("*/__init__.py")):
        if any((path.parent / file).is_file() for file in FILES.values()):
            studies[path.parent.name.replace("_", "-")] = _module(owner, path.parent.name).STUDY
    return dict(sorted(studies.items(), key=lambda item: item[1].order))


def parse(text: str) -> str:
    """Return "1/first-triangle" for it and for "ch01/first_triangle"; raise UserError if there is no such study."""
    chapter, _, wanted = text.partition("/")
    return _named(chapters.parse_chapter(chapter), wanted.removesuffix("/"))


def parse_path(path: Path) -> str | None:
    """Return the study that a path into a chapter's or a fork's folder names, or None if it leads to no such folder.

    Raises UserError where the chapter or the fork has no such study.
    """
    inside = path.parent.name == "studies"
    owner = path.parent.parent if inside else path.parent
    if path.is_file() or (path.is_dir() and not inside) or not folders.is_copy(owner):
        return None
    return _named(folders.read(owner), path.name)


def _named(owner: Whole, wanted: str) -> str:
    known = available(owner)
    name = wanted.strip().lower().replace("_", "-")
    if name not in known:
        near = suggest(name, known, shown=len(known))
        has = near or "; it has none"
        if isinstance(owner, folders.Folder) and not known:
            has = f"; `strata fork {owner.lesson.number} DIR --studies` makes a fork that has them"
        raise UserError(f"{spoken(owner)} has no study {wanted!r}{has}{'' if has.endswith('?') else '.'}")
    if isinstance(owner, folders.Folder) and str(owner).isdecimal():
        return f"{owner.path}/{name}"  # a folder named "3" is not chapter 3
    return f"{owner}/{name}"


def split(which: str) -> tuple[Whole, str]:
    """Return the chapter or the fork of a `which` that `parse` returned, and the name of the study."""
    owner, _, name = which.rpartition("/")
    return int(owner) if owner.isdecimal() else folders.read(Path(owner), owner), name


def chapter(which: str) -> int:
    """Return the number of the chapter that a study belongs to; for a fork's study that of the fork's chapter."""
    owner, _ = split(which)
    return owner if isinstance(owner, int) else owner.lesson.number


def study(which: str) -> Study:
    """Return what a study says about itself."""
    owner, name = split(which)
    return available(owner)[name]


def file_name(which: str) -> str:
    """Return how files about a study begin: "ch01-first-triangle"."""
    owner, name = split(which)
    return f"{chapters.file_name(owner)}-{name}"


def backends(which: str) -> tuple[str, ...]:
    """Return the backends that a study has a version for."""
    owner, name = split(which)
    place = folder(owner) / name.replace("-", "_")
    return tuple(backend for backend, file in FILES.items() if (place / file).is_file())


def renderer_module(which: str, backend: str) -> ModuleType:
    """Return the module with a study's renderer on "vulkan" or "gl"; raise UnsupportedError if there is none."""
    owner, name = split(which)
    if backend not in backends(which):
        other = "vulkan" if backend == "gl" else "gl"
        words = {"vulkan": "Vulkan", "gl": "OpenGL"}
        raise UnsupportedError(
            f"The study {which} has no {words[backend]} version: use --backend {other}, or leave --backend out."
        )
    return _module(owner, f"{name.replace('-', '_')}.{backend}")


def settings_class(which: str) -> type:
    """Return the class of a study's settings; one without knobs where it has none."""
    from backends.stage import NoSettings

    owner, name = split(which)
    settings: type = _module(owner, name.replace("-", "_")).__dict__.get("Settings") or NoSettings
    return settings


def display(which: Which, backend: str) -> Any:
    """Return a new `Display` for the window of a study that has one of its own (`DISPLAY` of its renderer's module).

    None for all others: their windows show pictures of 8-bit sRGB codes.
    """
    kind = renderer_module(which, backend).__dict__.get("DISPLAY") if isinstance(which, str) else None
    return kind() if kind is not None else None


def _module(owner: Whole, name: str) -> ModuleType:
    return import_module(f"{chapters.package_of(owner)}.studies.{name}")


# --- what `strata run` asks -------------------------------------------------------------------------------------------


def load(which: Which, text: str | None, progress: Progress | None = None, around: str = "none") -> Scene:
    """Load what is to be drawn: the scene meant by `text`, else that of `which`, in the environment `around`.

    A study that brings all it draws gets an empty scene. Raises UserError where a scene or an environment was named
    for a study that has no use for it.
    """
    from chapters import scenes

    if not isinstance(which, str):
        return scenes.load(scenes.DEFAULT if text is None else text, progress, around)
    owner, name = split(which)
    about = study(which)
    if around != "none":
        raise UserError(f"The study {which} has no environment: leave --environment out.")
    if text is not None and about.scene is None:
        raise UserError(f"The study {which} brings what it draws: leave --scene out.")
    if text is None and about.scene is None:
        from common.scene.primitive import nothing

        return nothing("no scene")
    if text is None and about.scene == OWN:
        own: Scene = _module(owner, name.replace("-", "_")).own_scene()
        return own
    return scenes.load(text if text is not None else about.scene or "", progress)


def preset_of(which: Which, quality: str) -> Any:
    """Return the settings of a chapter's preset; a study has one set of them. Raises SettingError."""
    from common.settings import preset

    kind = chapters.settings_class(which)
    return kind() if isinstance(which, str) else preset(kind, quality)


def spoken(which: Which) -> str:
    """Return what runs, as a sentence begins with it: "Chapter 1", "Study 1/first-triangle", "Fork my-ch01"."""
    if isinstance(which, str):
        return f"Study {which}"
    return f"Chapter {which}" if isinstance(which, int) else f"Fork {which.spoken}"


def picture_name(which: Which, scene: str | None) -> str:
    """Return the default name of a picture: what drew it, and the scene."""
    from chapters import scenes

    begin = chapters.file_name(which)
    if scene is None and isinstance(which, str):
        return begin
    text = scenes.DEFAULT if scene is None else scene
    path = Path(text)
    name = re.sub(r"[^\w.-]+", "-", path.stem if path.suffix.lower() in scenes.SUFFIXES else text)
    return f"{begin}-{name.strip('-') or 'scene'}"


def check(which: Which, quality: str, out: Path | None) -> None:
    """Raise UserError for options that only whole chapters know."""
    if not isinstance(which, str):
        return
    if quality != "auto":
        raise UserError(f"The study {which} has no presets: leave --quality out.")
    if out is not None and out.suffix.lower() == ".exr":
        outputs = ", ".join(study(which).outputs)
        raise UserError(f"--out {out}: the study {which} gives {outputs}, not linear light; write a .png.")
