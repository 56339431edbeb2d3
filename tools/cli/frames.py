"""The options of `strata frame` and `strata graph`; what they do is in `tools.frames`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.cli.options import (
    Backend,
    Camera,
    Chapter,
    Environment,
    Scene,
    Set,
    Size,
    Unchecked,
    Validate,
    Without,
)


def frame(
    chapter: Chapter,
    backend: Backend = "auto",
    scene: Scene = "atrium",
    environment: Environment = "none",
    size: Size = "640x360",
    camera: Camera = None,
    ev: Annotated[
        float | None, typer.Option(metavar="EV100", help="As for `strata run`.", show_default=False)
    ] = None,
    quality: Annotated[
        str, typer.Option(metavar="low|medium|high|reference", help="Preset of settings.")
    ] = "medium",
    set_: Set = None,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="The frame that shows a quantity of `list N --views`.", show_default=False
        ),
    ] = None,
    without: Without = None,
    after: Annotated[
        str | None,
        typer.Option(metavar="PASS", help="Show the passes up to this one.", show_default=False),
    ] = None,
    validate: Validate = False,
    no_validate: Unchecked = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; without it, in out/.", show_default=False),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(metavar="FILE|-", help="Write all figures; - prints them.", show_default=False),
    ] = None,
    time: Annotated[float, typer.Option(metavar="SECONDS", help="Time of the frame.")] = 0.0,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show all notes on the scene.")] = False,
) -> int:
    """Step through one frame: each pass with its time, work, inputs and a picture of every output, as a page."""
    import chapters
    from tools.frames import frame as stepping
    from tools.run import run as running

    which = chapters.parse_chapter(chapter)
    request = running.Request(
        chapter=which,
        backend=backend,
        scene=scene,
        environment=environment,
        ev100=ev,
        size=running.parse_size(size),
        camera=camera,
        quality=quality,
        overrides=tuple(set_ or ()),
        view=view,
        without=tuple(without or ()),
        validate=running.validation(which, validate, not no_validate, backend),
        json=json,
        time=time,
        headless=True,
        verbose=verbose,
    )
    return stepping.step_through(request, after, folder=out)


def graph(
    chapter: Chapter,
    backend: Backend = "auto",
    scene: Scene = "atrium",
    environment: Environment = "none",
    size: Size = "640x360",
    quality: Annotated[
        str, typer.Option(metavar="low|medium|high|reference", help="Preset of settings.")
    ] = "medium",
    set_: Set = None,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="The frame that shows a quantity of `list N --views`.", show_default=False
        ),
    ] = None,
    without: Without = None,
    outputs: Annotated[
        str,
        typer.Option(
            metavar="NAME,...", help="What is read of a frame; passes that lead to none of it are left out."
        ),
    ] = "color",
    json: Annotated[
        Path | None,
        typer.Option(metavar="FILE|-", help="Write the graph as JSON; - prints it.", show_default=False),
    ] = None,
    svg: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the graph as .svg.", show_default=False)
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show all notes on the scene.")] = False,
) -> int:
    """Show the compiled frame graph: order, barriers, queues, lifetimes, shared memory, what was left out and why."""
    import chapters
    from tools.frames import graph as showing
    from tools.run import run as running

    request = running.Request(
        chapter=chapters.parse_chapter(chapter),
        backend=backend,
        scene=scene,
        environment=environment,
        size=running.parse_size(size),
        quality=quality,
        overrides=tuple(set_ or ()),
        view=view,
        without=tuple(without or ()),
        json=json,
        headless=True,
        verbose=verbose,
    )
    return showing.show(request, tuple(filter(None, outputs.replace(" ", "").split(","))), svg)
