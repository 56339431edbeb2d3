"""The options of `strata assets get|add|list|remove|shrink` and `strata convert`; what they do is in `tools.assets`."""

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
    from tools.assets import command

    return command.get(names, yes)


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
    from tools.assets import command

    return command.add(path, name)


def list_() -> int:
    """Show the models that can be fetched, their sizes and licences, which are here, and your own."""
    from tools.assets import command

    return command.show()


def remove(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A model that is here.", show_default=False)],
) -> int:
    """Delete a fetched model, or forget the name of one of your own, whose file stays."""
    from tools.assets import command

    return command.remove(name)


def shrink(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="Pictures, folders of pictures, or .mtl files with the textures that they name.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where the files go; made if need be.", show_default=False)
    ],
    most: Annotated[int, typer.Option(metavar="TEXELS", help="Of a side, each on its own.")] = 512,
    data: Annotated[
        bool,
        typer.Option(
            "--data", help="The pictures hold normals, roughness or masks: average numbers, not light."
        ),
    ] = False,
) -> int:
    """Make small PNGs of textures; with .mtl files, maps of opacity go into the alpha, and materials become records."""
    from tools.assets.shrink import shrink as shrink_textures

    return shrink_textures(sources, out, most, data)


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
