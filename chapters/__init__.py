"""The fifteen lessons, and what must know all of them: `open`, the command line, the drivers of bench and site.

import chapters
from chapters import scenes

with chapters.open(1, scene=scenes.load("cornell"), size=(640, 360)) as renderer:
    frame = renderer.render(chapters.view_of(renderer))
    frame.show()
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from common.errors import UnsupportedError, UserError
from common.lessons import Lesson
from common.names import suggest

if TYPE_CHECKING:
    from backends.choice import Choice
    from backends.contract import Renderer
    from common.scene import Scene
    from common.view.camera import View
    from tools.run.opened import OpenedRenderer

FOLDER = Path(__file__).parent
COUNT = 15


@cache
def available() -> tuple[int, ...]:
    """Return the numbers of the chapters that are here, in order."""
    numbers = (n for n in range(1, COUNT + 1) if (FOLDER / folder_name(n) / "renderer.py").is_file())
    return tuple(numbers)


def folder_name(number: int) -> str:
    """Return "ch01" for 1."""
    return f"ch{number:02d}"


def parse(text: int | str | Path | Folder) -> Which:
    """Return the chapter meant by "1", "01" or "ch01", the study "1/name", or the fork in a folder.

    A text that looks like a chapter or a study is one; any other that names a folder, and every path, is a folder, or a
    study in the folder of a chapter or a fork: "my-ch01/first-triangle". Raises UserError if there is none such.
    """
    if isinstance(text, Folder):
        return text
    if isinstance(text, str) and not text.strip():
        return _number(text)  # which says so: as a path it would be the current folder
    path = folders.path_of(text)
    study = studies.parse_path(path) if path is not None else None
    if study is not None:
        return study
    folder = folders.read(text) if isinstance(text, Path) else folders.named(str(text))
    if folder is not None:
        return folder
    return studies.parse(str(text)) if "/" in str(text) else _number(str(text))


def parse_chapter(text: int | str | Path | Folder) -> Whole:
    """Return the chapter or the fork that is meant, as `parse` does; raise UserError for a study too."""
    which = parse(text)
    if isinstance(which, str):
        raise UserError(
            f"{which} is a study, and this is about whole chapters: write {studies.split(which)[0]}."
        )
    return which


def _number(text: str) -> int:
    digits = text.lower().removeprefix("ch")
    known = [str(number) for number in available()]
    if not (digits.isascii() and digits.isdigit()):
        near = suggest(text, [*known, *folders.beside()])
        raise UserError(f"There is no chapter {text!r}{near}" + ("" if near.endswith("?") else "."))
    number = int(digits)
    if number not in available():
        here = f"chapters {known[0]} to {known[-1]} are" if len(known) > 1 else f"chapter {known[0]} is"
        raise UserError(f"There is no chapter {number}: {here} here.")
    return number


def folder_of(which: Whole) -> Path:
    """Return the folder of a chapter or a fork."""
    return which.path if isinstance(which, Folder) else FOLDER / folder_name(which)


def package_of(which: Whole) -> str:
    """Return the name of the package of a chapter or a fork: "chapters.ch01"."""
    return which.package if isinstance(which, Folder) else f"chapters.{folder_name(which)}"


def title_of(which: Which) -> str:
    """Return the title of a chapter, a study or a fork."""
    return studies.study(which).title if isinstance(which, str) else lesson(which).title


def file_name(which: Which) -> str:
    """Return how the names of files about something begin: "ch01", "ch01-first-triangle", "my-ch01"."""
    if isinstance(which, str):
        return studies.file_name(which)
    return which.file_name if isinstance(which, Folder) else folder_name(which)


def lesson(which: Whole) -> Lesson:
    """Return what a chapter says about itself; a fork says what its chapter says."""
    if isinstance(which, Folder):
        return which.lesson
    lesson: Lesson = import_module(package_of(which)).LESSON
    return lesson


def settings_class(which: Which) -> type:
    """Return the class of the settings of a chapter, a study or a fork."""
    if isinstance(which, str):
        return studies.settings_class(which)
    settings: type = import_module(f"{package_of(which)}.settings").Settings
    return settings


def choose_backend(wanted: str = "auto", which: Which | None = None) -> str:
    """Return the backend to use, "vulkan" or "gl"; see `decide_backend`."""
    return decide_backend(wanted, which).backend


def decide_backend(wanted: str = "auto", which: Which | None = None) -> Choice:
    """Choose a backend and say why; see `backends.choice.decide` for the order and the errors.

    Where nothing else is wanted, a study that has one version only chooses that. A chapter takes a backend on which its
    trial frame is right. Studies and forks are not tried themselves; they go by what is known of their chapter.
    """
    from backends import choice

    if isinstance(which, int):
        from tools.doctor import trial

        return trial.decide(wanted, which)
    own = studies.backends(which) if isinstance(which, str) else ()
    if wanted == "auto" and len(own) == 1:
        name = {"vulkan": "Vulkan", "gl": "OpenGL"}[own[0]]
        chosen = choice.decide(own[0])
        return replace(
            chosen, reason=chosen.reason.replace("asked for", f"{name}, the only API of this study", 1)
        )
    if wanted == "auto" and which is not None:
        from tools.doctor import trial

        return trial.decide_for(studies.chapter(which) if isinstance(which, str) else which.lesson.number)
    return choice.decide(wanted)


def renderer_module(which: Which, backend: str) -> ModuleType:
    """Return the module with the renderer of a chapter, a study or a fork on "vulkan" or "gl".

    Raises UnsupportedError if there is none.
    """
    if isinstance(which, str):
        return studies.renderer_module(which, backend)
    name = folders.renderer_name(folder_of(which), backend)
    if not name:
        raise UnsupportedError(f"{studies.spoken(which)} has no OpenGL version: use --backend vulkan.")
    return import_module(f"{package_of(which)}.{name}")


def open(  # the name of the contract: chapters.open(6, ...)
    which: int | str | Path | Folder,
    backend: str = "auto",
    *,
    scene: Scene,
    size: tuple[int, int] = (640, 360),
    settings: Any = None,
    without: Iterable[str] | str = (),
    outputs: Collection[str] | str = ("color",),
    validate: bool = False,
    **more: Any,
) -> OpenedRenderer:
    """Open a chapter (1, "1" or "ch01"), a study ("1/first-triangle") or a fork (Path("my-ch01")) on `scene`.

    Returns its renderer, which is a context manager and whose frames can show themselves (`tools.run.opened`).

    `settings` is the chapter's `Settings` (None: its defaults), `without` names features to do without, `outputs` are
    the images that can be read. Further arguments go to the backend's renderer (`device=` shares a device).
    Raises UserError for a wrong argument, UnsupportedError where this machine cannot do it.
    """
    wanted = parse(which)
    module = renderer_module(wanted, choose_backend(backend, wanted))
    from tools.run.opened import showing

    opened: OpenedRenderer = showing(module.Renderer, wanted)(
        scene, size, settings=settings, without=without, outputs=outputs, validate=validate, **more
    )
    return opened


def outputs_of(which: Which) -> tuple[str, ...]:
    """Return the images that the frames of a chapter, a study or a fork can be asked for."""
    if isinstance(which, str):
        return tuple(studies.study(which).outputs)
    outputs: tuple[str, ...] = import_module(f"{package_of(which)}.frames.frame").OUTPUTS
    return outputs


def view_of(renderer: Renderer, camera: str | None = None, time: float = 0.0) -> View:
    """Return a view of the renderer's scene: its first camera, or what `camera` names (see `view_of_scene`)."""
    from common.scene.pose import evaluate_pose
    from common.view.camera import view_of_scene

    scene = renderer.scene
    return view_of_scene(scene, evaluate_pose(scene, time), camera, renderer.size[0] / renderer.size[1])


from chapters import folders, studies  # noqa: E402  # they ask this module back
from chapters.folders import Folder  # noqa: E402

Whole = int | Folder
"""A chapter by its number, or a fork."""

Which = int | str | Folder
"""The same, or a study by its name: "1/first-triangle"."""
