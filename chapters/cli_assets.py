"""The options of `strata assets get|add|list|remove`; what they do is in `chapters.asset_command`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def alone(context: typer.Context) -> int:
    """Models by name: well-known ones of others, which are fetched, and your own. Without a command: what there is."""
    return list_() if context.invoked_subcommand is None else 0


def get(
    names: Annotated[
        list[str],
        typer.Argument(metavar="NAME...", help="Names of `strata assets list`.", show_default=False),
    ],
    yes: Annotated[
        bool, typer.Option("--yes", help="Agree to the licence, which is shown all the same.")
    ] = False,
) -> int:
    """Fetch well-known models of others: pinned by commit and hash, the licence first, resumed where it stopped."""
    from chapters import asset_command

    return asset_command.get(names, yes)


def add(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="A .gltf, .glb or .obj file.", show_default=False)
    ],
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="What to call it; that of the file.", show_default=False),
    ] = None,
) -> int:
    """Examine a model of your own: what is in it, what is not drawn as it says; then --scene NAME finds it."""
    from chapters import asset_command

    return asset_command.add(path, name)


def list_() -> int:
    """Show the models that can be fetched, their sizes and licences, which are here, and your own."""
    from chapters import asset_command

    return asset_command.show()


def remove(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A model that is here.", show_default=False)],
) -> int:
    """Delete a fetched model, or forget the name of one of your own, whose file stays."""
    from chapters import asset_command

    return asset_command.remove(name)
