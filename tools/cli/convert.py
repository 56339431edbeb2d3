"""The options of `strata convert`; what it does is in `tools.assets.convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def convert(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="A scene as for `strata run`.", show_default=False)
    ],
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where its files go.", show_default=False)],
    uv: Annotated[bool, typer.Option("--uv/--no-uv", help="8 bytes of a vertex.")] = True,
    normals: Annotated[bool, typer.Option("--normals/--no-normals", help="12 bytes of a vertex.")] = True,
    merge: Annotated[
        bool,
        typer.Option("--merge", help="Make one mesh of all that has one material."),
    ] = False,
    lods: Annotated[
        bool, typer.Option("--lods", help="Make levels of detail; meshoptimizer has to be there.")
    ] = False,
) -> int:
    """Write a scene as files that a program of your own reads without parsing: meshes, instances, nodes, materials."""
    from tools.assets import convert as converting

    return converting.run(scene, folder, uv=uv, normals=normals, merge=merge, lods=lods)
