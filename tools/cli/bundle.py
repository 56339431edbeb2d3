"""The options of `strata bundle`; what it does is in `tools.bundle.bundle`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def bundle(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.", show_default=False)],
    systems: Annotated[
        list[str] | None,
        typer.Option(
            "--for",
            metavar="SYSTEM",
            help="linux, linux-arm64, windows, macos-arm64 or macos-x86_64; repeatable. Without it: this one.",
        ),
    ] = None,
    pythons: Annotated[
        list[str] | None,
        typer.Option(
            "--python", metavar="3.X", help="Python there; repeatable. Without it: the version here."
        ),
    ] = None,
    extras: Annotated[bool, typer.Option("--extras", help="Pack all optional packages too.")] = False,
    with_site: Annotated[
        bool, typer.Option("--site", help="Build the site first; without it, pack it if it was built.")
    ] = False,
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--models", metavar="NAME|PATH", help="A model to pack, as --scene takes it; repeatable."
        ),
    ] = None,
) -> int:
    """Pack clone, packages, site and models into one file, for machines without a network."""
    from tools.bundle import bundle

    return bundle.run(file, systems or (), pythons or (), extras, with_site, models or ())
