"""The fifteen lessons, and what must know all of them: `open`, the command line, the drivers of bench and site.

import chapters
from common.gltf import load_scene

with chapters.open(1, scene=load_scene("helmet.gltf"), size=(640, 360)) as renderer:
    picture = renderer.render(chapters.view_of(renderer)).image("color")
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from common.errors import UnsupportedError, UserError
from common.lessons import Lesson
from common.names import suggest

if TYPE_CHECKING:
    from backends.contract import Renderer
    from common.camera import View
    from common.scene import Scene

FOLDER = Path(__file__).parent
COUNT = 15


@cache
def available() -> tuple[int, ...]:
    """Return the numbers of the chapters that are here, in order."""
    found = (n for n in range(1, COUNT + 1) if (FOLDER / folder_name(n) / "renderer.py").is_file())
    return tuple(found)


def folder_name(number: int) -> str:
    """Return "ch01" for 1."""
    return f"ch{number:02d}"


def parse(text: str) -> int | str:
    """Return the chapter meant by "1", "01" or "ch01", or the study "1/name"; raise UserError if there is none."""
    if "/" in text:
        return studies.parse(text)
    return parse_chapter(text)


def parse_chapter(text: str) -> int:
    """Return the chapter meant by "1", "01" or "ch01"; raise UserError if there is none, and for a study."""
    if "/" in text:
        study = studies.parse(text)
        raise UserError(
            f"{study} is a study, and this is about whole chapters: write {studies.split(study)[0]}."
        )
    digits = text.lower().removeprefix("ch")
    known = [str(number) for number in available()]
    if not (digits.isascii() and digits.isdigit()):
        near = suggest(text, known)
        raise UserError(f"There is no chapter {text!r}{near}" + ("" if near.endswith("?") else "."))
    number = int(digits)
    if number not in available():
        here = f"chapters {known[0]} to {known[-1]} are" if len(known) > 1 else f"chapter {known[0]} is"
        raise UserError(f"There is no chapter {number}: {here} here.")
    return number


def title_of(which: int | str) -> str:
    """Return the title of a chapter or a study."""
    return studies.study(which).title if isinstance(which, str) else lesson(which).title


def file_name(which: int | str) -> str:
    """Return how the names of files about a chapter or a study begin: "ch01", "ch01-first-triangle"."""
    return studies.file_name(which) if isinstance(which, str) else folder_name(which)


def lesson(number: int) -> Lesson:
    """Return what chapter `number` says about itself."""
    found: Lesson = import_module(f"chapters.{folder_name(number)}").LESSON
    return found


def settings_class(number: int | str) -> type:
    """Return the class of the settings of a chapter or a study."""
    if isinstance(number, str):
        return studies.settings_class(number)
    found: type = import_module(f"chapters.{folder_name(number)}.settings").Settings
    return found


def choose_backend(wanted: str = "auto") -> str:
    """Return the backend to use, "vulkan" or "gl"; see `backends.choice.decide` for its errors."""
    from backends.choice import choose

    return choose(wanted)


def renderer_module(number: int | str, backend: str) -> ModuleType:
    """Return the module with the renderer of a chapter or a study on "vulkan" or "gl".

    Raises UnsupportedError if there is none.
    """
    if isinstance(number, str):
        return studies.renderer_module(number, backend)
    folder = folder_name(number)
    if backend == "gl" and not (FOLDER / folder / "gl" / "renderer.py").is_file():
        raise UnsupportedError(f"Chapter {number} has no OpenGL version: use --backend vulkan.")
    return import_module(
        f"chapters.{folder}.gl.renderer" if backend == "gl" else f"chapters.{folder}.renderer"
    )


def open(  # the name of the contract: chapters.open(6, ...)
    number: int | str,
    backend: str = "auto",
    *,
    scene: Scene,
    size: tuple[int, int] = (640, 360),
    settings: Any = None,
    without: Iterable[str] | str = (),
    outputs: Collection[str] | str = ("color",),
    validate: bool = False,
    **more: Any,
) -> Renderer:
    """Open chapter `number` (1, "1" or "ch01") or a study ("1/first-triangle") on `scene` and return its renderer.

    It is a context manager.

    `settings` is the chapter's `Settings` (None: its defaults), `without` names features to do without, `outputs` are
    the images that can be read. Further arguments go to the backend's renderer (`device=` shares a device).
    Raises UserError for a wrong argument, UnsupportedError where this machine cannot do it.
    """
    number = parse(str(number))
    module = renderer_module(number, choose_backend(backend))
    opened: Renderer = module.Renderer(
        scene, size, settings=settings, without=without, outputs=outputs, validate=validate, **more
    )
    return opened


def outputs_of(number: int | str) -> tuple[str, ...]:
    """Return the images that the frames of a chapter or a study can be asked for."""
    if isinstance(number, str):
        return tuple(studies.study(number).outputs)
    found: tuple[str, ...] = import_module(f"chapters.{folder_name(number)}.renderer").OUTPUTS
    return found


def view_of(renderer: Renderer, camera: str | None = None, time: float = 0.0) -> View:
    """Return a view of the renderer's scene: its first camera, or what `camera` names (see `view_of_scene`)."""
    from common.camera import view_of_scene
    from common.pose import evaluate_pose

    scene = renderer.scene
    return view_of_scene(scene, evaluate_pose(scene, time), camera, renderer.size[0] / renderer.size[1])


from chapters import studies  # noqa: E402  # it asks this module back
