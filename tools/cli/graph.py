"""The options of `strata graph`; what it does is in `tools.frames.graph`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.cli.options import Backend, Chapter, Environment, Scene, Set, Size, Without


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
