"""The studies of the chapters: finding them by name, "1/first-triangle", and what the command line asks of them."""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import chapters
from common.errors import UnsupportedError, UserError
from common.lessons import OWN, Study
from common.names import suggest

if TYPE_CHECKING:
    from chapters import Which
    from common.gltf.load import Progress
    from common.scene import Scene

FILES = {"vulkan": "vulkan.py", "gl": "gl.py"}
"""The file of a study's renderer on each backend."""


def folder(number: int) -> Path:
    """Return the folder of a chapter's studies."""
    return chapters.FOLDER / chapters.folder_name(number) / "studies"


@cache
def available(number: int) -> dict[str, Study]:
    """Return the studies of a chapter by name, in the order in which they are meant to be read."""
    studies = {}
    for path in sorted(folder(number).glob("*/__init__.py")):
        if any((path.parent / file).is_file() for file in FILES.values()):
            studies[path.parent.name.replace("_", "-")] = _module(number, path.parent.name).STUDY
    return dict(sorted(studies.items(), key=lambda item: item[1].order))


def parse(text: str) -> str:
    """Return "1/first-triangle" for it and for "ch01/first_triangle"; raise UserError if there is no such study."""
    chapter, _, wanted = text.partition("/")
    number = chapters.parse_chapter(chapter)
    known = available(number)
    name = wanted.strip().lower().replace("_", "-").removesuffix("/")
    if name not in known:
        near = suggest(name, known, shown=len(known))
        has = near or "; it has none"
        raise UserError(f"Chapter {number} has no study {wanted!r}{has}{'' if has.endswith('?') else '.'}")
    return f"{number}/{name}"


def split(which: str) -> tuple[int, str]:
    """Return the chapter's number and the study's name of a `which` that `parse` returned."""
    chapter, _, name = which.partition("/")
    return int(chapter), name


def study(which: str) -> Study:
    """Return what a study says about itself."""
    number, name = split(which)
    return available(number)[name]


def file_name(which: str) -> str:
    """Return how files about a study begin: "ch01-first-triangle"."""
    number, name = split(which)
    return f"{chapters.folder_name(number)}-{name}"


def backends(which: str) -> tuple[str, ...]:
    """Return the backends that a study has a version for."""
    number, name = split(which)
    place = folder(number) / name.replace("-", "_")
    return tuple(backend for backend, file in FILES.items() if (place / file).is_file())


def renderer_module(which: str, backend: str) -> ModuleType:
    """Return the module with a study's renderer on "vulkan" or "gl"; raise UnsupportedError if there is none."""
    number, name = split(which)
    if backend not in backends(which):
        other = "vulkan" if backend == "gl" else "gl"
        words = {"vulkan": "Vulkan", "gl": "OpenGL"}
        raise UnsupportedError(
            f"The study {which} has no {words[backend]} version: use --backend {other}, or leave --backend out."
        )
    return _module(number, f"{name.replace('-', '_')}.{backend}")


def settings_class(which: str) -> type:
    """Return the class of a study's settings; one without knobs where it has none."""
    from backends.stage import NoSettings

    number, name = split(which)
    settings: type = _module(number, name.replace("-", "_")).__dict__.get("Settings") or NoSettings
    return settings


def _module(number: int, name: str) -> ModuleType:
    return import_module(f"chapters.{chapters.folder_name(number)}.studies.{name}")


# --- what `strata run` asks -------------------------------------------------------------------------------------------


def load(which: Which, text: str | None, progress: Progress | None = None, around: str = "none") -> Scene:
    """Load what is to be drawn: the scene meant by `text`, else that of `which`, in the environment `around`.

    A study that brings all it draws gets an empty scene. Raises UserError where a scene or an environment was named
    for a study that has no use for it.
    """
    from chapters import scenes

    if not isinstance(which, str):
        return scenes.load(scenes.DEFAULT if text is None else text, progress, around)
    number, name = split(which)
    about = study(which)
    if around != "none":
        raise UserError(f"The study {which} has no environment: leave --environment out.")
    if text is not None and about.scene is None:
        raise UserError(f"The study {which} brings what it draws: leave --scene out.")
    if text is None and about.scene is None:
        from common.scene.primitive import nothing

        return nothing("no scene")
    if text is None and about.scene == OWN:
        own: Scene = _module(number, name.replace("-", "_")).own_scene()
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
