"""`strata graph N`: the frame graph that a chapter compiles for a scene, as text, JSON and SVG."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import chapters
from chapters import studies
from common.errors import UserError
from common.paths import write_whole, written_file
from tools.cli.console import Steps, err, out, say
from tools.cli.stopping import prompt_stop
from tools.frames import report
from tools.frames.svg import svg
from tools.run import run
from tools.run.record import STDOUT

GRAPH = "graph/frame_graph.py"
"""The module of a chapter that compiles its graph; a chapter without it has none."""


def show(request: run.Request, outputs: tuple[str, ...] = ("color",), drawing: Path | None = None) -> int:
    """Open the chapter, without a window, and show its graph; return the exit code. Raises StrataError.

    The text is printed; `request.json` and `drawing` name the files of JSON and SVG.
    """
    which = chapters.parse_chapter(request.chapter)
    if not (chapters.folder_of(which) / GRAPH).is_file():
        here = [number for number in chapters.available() if (chapters.folder_of(number) / GRAPH).is_file()]
        raise UserError(_without_graph(which, here))
    run.check(request)
    if drawing is not None:
        _check_drawing(drawing, request.json)
    with prompt_stop():
        graph, device = compiled(which, request, outputs)
    name = request.scene or ""
    title = f"{studies.spoken(which)}, {name}, {device}"
    if request.json is not None:
        _write("--json", request.json, json.dumps(report.record(graph), indent=1) + "\n")
    if drawing is not None:
        _write("--svg", drawing, svg(graph, title))
    printed = err if request.json == STDOUT else out
    printed.print(f"{title}\n{report.text(graph)}", markup=False, soft_wrap=True, end="")
    for path in (request.json, drawing):
        if path is not None and path != STDOUT:
            say(f"wrote {path}")
    return 0


def _without_graph(which: chapters.Whole, here: list[int]) -> str:
    there = f"./strata graph {here[0]} shows the first one" if here else "no chapter that is here has one"
    return f"{studies.spoken(which)} has no frame graph, since its passes are put in order by hand: {there}."


def _check_drawing(path: Path, record: Path | None) -> None:
    target = written_file(path.absolute())
    if path == STDOUT or target.is_dir() or not target.parent.is_dir():
        raise UserError(f"--svg {path} cannot be written: name a file in a folder that exists.")
    if path.suffix.lower() != ".svg":
        raise UserError(
            f"--svg {path} would be a drawing under another name: write it as {path.with_suffix('.svg')}."
        )
    if record is not None and record != STDOUT and written_file(record.absolute()) == target:
        raise UserError(f"--svg and --json both name {path}: the drawing and the record are two files.")


def compiled(
    which: chapters.Whole, request: run.Request, outputs: tuple[str, ...] = ("color",)
) -> tuple[Any, str]:
    """Return the graph of a renderer that is opened for it, and the name of its device. Raises StrataError."""
    settings = run.settings_of(request, "medium" if request.quality == "auto" else request.quality)
    with Steps() as steps, run.open_drawn(request, steps) as opening:
        steps("create", 0.5)
        with chapters.open(
            which,
            request.backend,
            scene=opening.scene,
            size=request.size,
            settings=settings,
            without=request.without,
            outputs=outputs,
        ) as renderer:
            graph = getattr(renderer, "graph", None)
            if graph is None:
                raise UserError(_without_graph(which, []))
            return graph, renderer.capabilities.device


def _write(option: str, path: Path, text: str) -> None:
    """Write a file, whole or not at all; to `STDOUT`, print it."""
    if path == STDOUT:
        sys.stdout.write(text)
        return
    try:
        write_whole(path.absolute(), text.encode())
    except OSError as error:
        raise UserError(f"{option} {path} cannot be written: {error.strerror or error}.") from None
