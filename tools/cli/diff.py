"""The options of `strata diff`; what it does is in `tools.diff.command`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def diff(
    a: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="A chapter, 1; its OpenGL version, 1@gl; or the folder of a copy of one.",
            show_default=False,
        ),
    ],
    b: Annotated[
        str, typer.Argument(metavar="B", help="The same; what it adds to A is shown.", show_default=False)
    ],
    stat: Annotated[bool, typer.Option("--stat", help="Only a table of files with counts.")] = False,
    html: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write one page that needs no network; arrow keys step through it at large type.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="shaders|graphics|gl|passes|logic", help="Only this part of the chapters; repeatable."
        ),
    ] = None,
    all_: Annotated[bool, typer.Option("--all", help="Unfold plumbing, and print new files whole.")] = False,
    pictures: Annotated[
        bool | None,
        typer.Option(
            "--pictures/--no-pictures",
            help="Draw what each changed pass writes before and after; a page has that unless told otherwise.",
            show_default=False,
        ),
    ] = None,
    lecture: Annotated[
        bool,
        typer.Option("--lecture", help="With --html: 10 to 15 stops with notes; a key shows the difference."),
    ] = False,
) -> int:
    """Show what one chapter adds to another: new files, changed functions with their lines, counts."""
    from tools.diff import command

    return command.run(
        a,
        b,
        stat=stat,
        html=html,
        only=tuple(only or ()),
        everything=all_,
        pictures=pictures,
        lecture=lecture,
    )
