"""The options of `strata docs`; what it does is in `tools.site.site`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def docs(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="Where the site goes; out/site.", show_default=False),
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Show it at an address of this machine.")] = False,
    port: Annotated[
        int, typer.Option(metavar="N", help="The port of that; 0 takes a free one.", min=0, max=65535)
    ] = 8000,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Fail where a page lacks something, a link leads nowhere or a picture is out of date.",
        ),
    ] = False,
    drawing: Annotated[
        bool,
        typer.Option(
            "--draw/--no-draw", help="Leave out what has to be drawn: frame graphs, pictures of passes."
        ),
    ] = True,
) -> int:
    """Build the site: lessons, differences, plots and pictures, all made by the project itself."""
    from tools.site import site

    return site.run(folder, serve=serve, check=check, port=port, drawing=drawing)
