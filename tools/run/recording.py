"""`strata run N --path P`: a frame for each view of a camera path, as an animation or as numbered pictures.

One renderer draws all frames, each once, so that histories live as they do in a window.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import chapters
from backends.contract import check_time
from common import images
from common.errors import UserError
from common.view.paths import CameraPath, Stage, parse_path
from tools.run.films import FILMS, check_film, write_film
from tools.run.pacing import Pacer

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from tools.run.record import Log
    from tools.run.run import Request

USUAL_FRAMES = 120
"""Frames of a path that has no end of its own."""
MOST_NUMBERED = 1_000_000
_NUMBER = re.compile(r"%(?:0([1-9]))?d")
"""What stands for the number of the frame in the name of a picture: %d or %04d."""


def planned(text: str, frames: int | None, fps: float) -> tuple[CameraPath, int]:
    """Return a path and how many frames of it are drawn. Raises UserError."""
    path = parse_path(text)
    return path, frames or path.frames(fps) or USUAL_FRAMES


def numbered(target: Path) -> Path | None:
    """Return the pattern of numbered pictures, a path with one %d or %04d; None for what is an animation."""
    if target.is_dir():
        return target / "%04d.png"
    return target if _NUMBER.search(target.name) else None


def picture_path(pattern: Path, number: int) -> Path:
    """Return the file of a frame."""
    name = _NUMBER.sub(lambda found: f"{number:0{found[1] or 1}d}", pattern.name, count=1)
    return pattern.with_name(name)


def check(request: Request) -> None:
    """Raise UserError for what is wrong with a request for a path before anything is opened."""
    assert request.path is not None
    _, count = planned(request.path, request.frames, request.fps)
    check_time(request.time + (count - 1) / request.fps, "With --path and --fps the last --time")
    if request.watch:
        raise UserError("--watch writes one picture, and --path many: leave one of them out.")
    if request.out is None:
        check_film(Path(f"{file_name(request.path)}.webp"), count, request.size, request.fps)
        return
    pattern = numbered(request.out)
    if pattern is None:
        _check_animation(request.out)
        check_film(request.out, count, request.size, request.fps)
        return
    if len(_NUMBER.findall(pattern.name)) > 1:
        raise UserError(f"--out {request.out} has more than one number: write %04d once.")
    if count > MOST_NUMBERED:
        raise UserError(f"{count} frames are too many pictures: at most {MOST_NUMBERED} are numbered.")
    images.check_writable(picture_path(pattern, 0), (".png", ".exr"))


def _check_animation(out: Path) -> None:
    """Raise UserError for a file that cannot hold an animation, with what could be meant."""
    suffix = out.suffix.lower()
    if suffix in FILMS:
        return
    if not suffix:
        raise UserError(
            f"--out {out}: there is no such folder for numbered pictures, and an animation ends with "
            f"{', '.join(FILMS)}: create the folder, or name such a file."
        )
    pictures = f"{out.stem}-%04d{suffix if suffix == '.exr' else '.png'}"
    raise UserError(
        f"--out {out} is no animation: name {', '.join(FILMS)}, a folder, or numbered pictures (.png or .exr), such as "
        f"{pictures}."
    )


def file_name(path: str) -> str:
    """Return what stands for a path in the name of a file."""
    words = Path(path).stem if path.lower().endswith(".json") else path
    return re.sub(r"[^\w.=,-]+", "-", words)[:80]


def spoken(files: list[str], request: Request) -> str:
    """Return which files were written, as the end of a sentence: of an animation also its frames per second."""
    if len(files) > 1:
        return f"{len(files)} pictures, {files[0]} to {files[-1]}"
    moves = request.path is not None and (request.out is None or numbered(request.out) is None)
    return f"{files[0]}, {request.fps:g} frames a second" if moves else files[0]


def record(request: Request, renderer: Renderer, log: Log, target: Path, steps: Any) -> list[str]:
    """Draw all frames of the path and write them; return the files that were written."""
    from tools.run.run import write_picture

    assert request.path is not None
    path, count = planned(request.path, request.frames, request.fps)
    start = chapters.view_of(renderer, request.camera, request.time)
    stage = Stage.of(renderer.scene, start, request.size)

    pacer = Pacer()

    def drawn() -> Iterator[Frame]:
        for index, view in enumerate(path.views(stage, count, request.fps)):
            steps("first frame" if index == 0 else "frames", 0.7 + 0.3 * index / count)
            frame = pacer.render(renderer, view, request.time + index / request.fps)
            log.add(frame)
            yield frame

    pattern = numbered(target)
    files = []
    if request.out is None:
        target.parent.mkdir(exist_ok=True)
    if pattern is None:
        write_film(target, (frame.image("color") for frame in drawn()), count, request.fps)
        files.append(str(target))
    else:
        for index, frame in enumerate(drawn()):
            files.append(str(picture_path(pattern, index)))
            write_picture(Path(files[-1]), frame)
    return files
