"""`strata reference N`: trace a chapter's scene until the error is small, and write the picture with what it is of."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from chapters import scenes, studies
from common import images
from common.errors import UserError
from common.images.color import encode_srgb
from common.paths import write_problem, write_whole
from common.settings import flat
from tools.cli.console import Steps, say
from tools.cli.stopping import prompt_stop
from tools.reference.settings import TRACER, chapter_settings, differences, keyed, tracer_settings
from tools.reference.sums import Sums
from tools.reference.tracing import (
    DEFAULT_PATHS,
    Keeper,
    Task,
    cached_path,
    check_goal,
    check_room,
    task_of,
    trace,
)
from tools.run import run as running
from tools.run.record import naming, strata_version

PICTURES = (".exr", ".png", ".npy")
"""What --out names: light in nits as floats, or with .png what a screen shows."""


@dataclass(frozen=True)
class Request:
    """What the user asked for."""

    chapter: chapters.Whole
    backend: str = "auto"
    scene: str = scenes.DEFAULT
    environment: str = "none"
    ev100: float | None = None
    size: tuple[int, int] = (640, 360)
    camera: str | None = None
    time: float = 0.0
    error: float = 0.01
    paths: int = DEFAULT_PATHS
    filter: str = "box"
    seed: int = 0
    overrides: tuple[str, ...] = ()
    sums: Path | None = None
    cached: bool = True
    out: Path | None = None
    verbose: bool = False


def run(request: Request) -> int:
    """Trace and write what was asked for; return the exit code. Raises StrataError."""
    name = studies.picture_name(request.chapter, request.scene)
    target = request.out or running.in_out(f"{name}-reference.exr")
    drawn = as_drawn(request)
    own, of_paths = _check(request, drawn, target)
    settings = tracer_settings(own, request.filter, request.seed, of_paths)
    with Steps() as steps:
        load: Any = steps.of("load", 0.0, 0.1)
        scene = scenes.load(request.scene, load, request.environment)
        running.expose(scene, drawn)
        running.tell_warnings(scene, request.verbose)
        steps("read what is traced already", 0.1)
        task = task_of(settings, scene, request.camera, request.size, request.time, request.backend)
        keeper = _keeper(request, task)
        before = keeper.sums.paths
        told = differences(request.chapter, own, scene)
        error = _traced(request, task, keeper, target, steps)
        steps("write", 0.98)
        if request.out is None:
            target.parent.mkdir(exist_ok=True)
        notes = notes_on_request(request, task, keeper.facts, told) | notes_on_paths(keeper.sums, error)
        try:
            with prompt_stop():
                write(target, keeper.sums, task.exposure, notes)
        except UserError as failed:
            raise UserError(f"{str(failed).rstrip('.')}. {_where(keeper)}".rstrip()) from None
    _tell(request, keeper, before, error, target)
    if told:
        say(f"strata: {told}")
    return 0


def as_drawn(request: Request) -> running.Request:
    """Return the same as a request of `strata run`, which checks and exposes alike."""
    return running.Request(
        TRACER,
        request.backend,
        request.scene,
        request.environment,
        request.ev100,
        request.size,
        camera=request.camera,
        time=request.time,
    )


def check_traced(request: Request, drawn: running.Request) -> None:
    """Raise UserError for what is wrong with the picture that is asked for."""
    running.check(drawn)
    check_goal(request.error, request.paths, request.filter, request.seed)
    check_room(request.size)


def _check(request: Request, drawn: running.Request, target: Path) -> tuple[Any, tuple[str, ...]]:
    """Raise UserError for what is wrong before anything is opened; return settings as `chapter_settings` does."""
    check_traced(request, drawn)
    # The folder `out` may be missing, and is made at the end.
    images.check_writable(target if target.parent.is_dir() or request.out else Path(target.name), PICTURES)
    sums = request.sums
    if sums is not None:
        if sums.suffix.lower() != ".npz":
            raise UserError(f"--sums {sums} is no file of sums: its name must end in .npz.")
        problem = "" if sums.is_file() else write_problem(sums)  # a file with enough paths is read alone
        if problem:
            raise UserError(f"--sums {sums} cannot be written: {problem}.")
        if sums.exists() and not sums.is_file():
            raise UserError(f"--sums {sums} is a device, and keeps nothing: name a file.")
        if not request.cached:
            raise UserError("--sums keeps what --no-cache forgets: leave one out.")
    return chapter_settings(request.chapter, request.overrides)


def _keeper(request: Request, task: Task) -> Keeper:
    """Return the sums that are there, of --sums or of the cache. Raises UserError for a wrong file of --sums."""
    facts = task.facts()
    if request.sums is not None:
        return Keeper(request.sums, facts, request.size, named=True)
    return Keeper(cached_path(facts) if request.cached else None, facts, request.size)


def _traced(request: Request, task: Task, keeper: Keeper, target: Path, steps: Steps) -> float:
    """Trace, and say what becomes of the sums where that is interrupted."""
    begin, told = 0.12, False

    def last_words() -> str:
        nonlocal told
        kept = keeper.keep()
        beside = target.with_name(f"{target.name}.npz")
        if told or not keeper.sums.paths:
            return ""
        told = True
        paths = f"strata: {_counted(keeper.sums.paths)} traced"
        if kept and request.sums is None:
            return f"{paths} and kept: the same command goes on with them."
        if kept:
            return f"{paths} and kept in {keeper.path}."
        if keeper.keep_beside(beside):
            return f"{paths} and kept in {beside}: --sums {beside} goes on with them."
        return f"{paths}, and neither the cache nor {beside} could be written: they are lost."

    steps("open the path tracer", begin)
    said = ""

    def progress(part: float, detail: str) -> None:
        nonlocal said
        if keeper.problem and keeper.problem != said:
            said = keeper.problem
            say(
                f"strata: {keeper.path} cannot be written ({said}): tracing goes on, and sums stay in memory."
            )
        advance(part, detail)

    advance: Any = steps.of("trace", begin, 0.98)
    with prompt_stop(last_words):
        try:
            return trace(task, keeper, request.error, request.paths, progress)
        except BaseException:
            steps.finish()
            words = last_words()
            say(words) if words else None
            raise


def write(path: Path, sums: Sums, exposure: float, notes: dict[str, Any]) -> None:
    """Write a reference in the format of its suffix; `exposure` is the factor from nits. Raises UserError.

    .exr has light in nits, the estimated relative errors of pixels and the numbers of their paths as layers `error`
    and `paths`, and `notes` as attributes of its header. .png has what a screen shows at the view's exposure, without
    a tone curve, and notes as texts; .npy has light alone.
    """
    picture, suffix = sums.picture, path.suffix.lower()
    if suffix == ".exr":
        errors = np.sqrt(sums.squared_errors(exposure)).astype(np.float32)
        layers = {"": picture, "error": errors, "paths": sums.light[..., 3].astype(np.uint32)}
        images.write_layers(path, layers, notes)
        return
    if suffix == ".png":
        shown = encode_srgb(np.clip(picture.astype(np.float64) * exposure, 0.0, 1.0))
        codes = np.rint(255 * shown).astype(np.uint8)
        data = images.encode_png(codes, srgb=True, notes=notes)
    else:
        stream = io.BytesIO()
        np.save(stream, picture)
        data = stream.getvalue()
    try:
        write_whole(path, data)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None


def notes_on_request(request: Request, task: Task, facts: dict[str, str], left_out: str) -> dict[str, Any]:
    """Return what a picture says about what it is of, by names of attributes; `left_out` as `differences` has it."""
    settings = {name: value for name, value in flat(task.settings).items() if keyed(name)}
    return {
        "strata": strata_version(),
        "chapter": str(naming(request.chapter)["chapter"]),
        "scene": task.scene.name,
        "sceneHash": facts["scene"],
        "camera": request.camera or "",
        "time": f"{request.time:g}",
        "ev100": f"{task.view.ev100:g}",
        "filter": request.filter,
        "seed": str(request.seed),
        "settings": json.dumps(settings, sort_keys=True),
        "backend": task.backend,
        "pathTracer": facts["version of the path tracer"],
        "leftOutByDesign": left_out,
    }


def notes_on_paths(sums: Sums, error: float) -> dict[str, Any]:
    """Return what a picture says about its paths, by names of attributes."""
    return {
        "paths": str(sums.paths),
        "pathsLeftOut": str(sums.left_out),
        "estimatedError": f"{error:.6g}",
        "devices": "; ".join(sums.devices),
    }


def _tell(request: Request, keeper: Keeper, before: int, error: float, target: Path) -> None:
    """Say what was written, of how many paths, and what is to be known about it."""
    sums = keeper.sums
    width, height = request.size
    what = (
        f"{studies.spoken(request.chapter)}, {request.scene}, {width}x{height}, {' and '.join(sums.devices)}"
    )
    new = sums.paths - before
    old = f", {before} of them traced before" if new and before else "" if new else ", all traced before"
    say(f"{what}: {_counted(sums.paths)}{old}, estimated error {error:.3g}: wrote {target}")
    if error > request.error and sums.paths > request.paths:
        say(
            f"strata: the estimated error is not yet {request.error:g}, and {_counted(sums.paths)} are there already, "
            f"more than --paths {request.paths} asks for: with a number above {sums.paths} the same command goes on."
        )
    elif error > request.error:
        say(
            f"strata: the estimated error is not yet {request.error:g}: --paths {request.paths} allows no more; "
            "with a larger number the same command goes on."
        )
    if sums.left_out:
        say(
            f"strata: {sums.left_out} of {sums.paths * width * height} paths had light that is no number, and are left "
            "out: a material or a light of the scene may be wrong."
        )
    if not keeper.is_kept and (request.cached or request.sums):
        say(f"strata: sums of paths are not kept, since {keeper.path or 'the cache'} cannot be written.")


def _counted(paths: int) -> str:
    return "1 path a pixel" if paths == 1 else f"{paths} paths a pixel"


def _where(keeper: Keeper) -> str:
    return f"Its sums are kept in {keeper.path}." if keeper.path is not None and keeper.is_kept else ""
