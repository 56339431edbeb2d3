"""The options of `strata exercise` and `strata check`; what they do is in `tools.exercises.command`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.errors import UserError


def exercise(
    chapter: Annotated[str, typer.Argument(metavar="N", help="Number of the chapter.", show_default=False)],
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="One of its exercises; without it: all.", show_default=False),
    ] = None,
    into: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Make a folder with it, a fork of the chapter.", show_default=False),
    ] = None,
    hint: Annotated[bool, typer.Option("--hint", help="Show its hints.")] = False,
    solution: Annotated[
        bool, typer.Option("--solution", help="Show its solution; with --into: a folder that has it.")
    ] = False,
    remake: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="For authors: start=FORK or solution=FORK makes a patch again, answers those of a prediction.",
            show_default=False,
        ),
    ] = None,
) -> int:
    """List the exercises of a chapter, tell what one asks, or make a folder to work in."""
    import chapters
    from tools.exercises import command

    which = chapters.parse_chapter(chapter)
    if not isinstance(which, int):
        raise UserError(f"{which} is a fork: exercises belong to chapters, as `strata exercise 1`.")
    if remake is not None:
        if name is None or into is not None or hint or solution:
            raise UserError("--remake takes a chapter, a name and nothing else.")
        return command.remake(which, name, remake)
    if hint and (solution or into is not None):
        raise UserError("--hint stands alone; in the folder, `strata check DIR --hint` gives one at a time.")
    return command.run(which, name, into=into, hint=hint, solution=solution)


def check(
    folder: Annotated[
        str, typer.Argument(metavar="DIR", help="A folder made by `strata exercise`.", show_default=False)
    ],
    hint: Annotated[bool, typer.Option("--hint", help="One hint more each time.")] = False,
    solution: Annotated[bool, typer.Option("--solution", help="Show the solution.")] = False,
) -> int:
    """Say in a sentence what is not right yet in the folder of an exercise (exit code 1), or that all is (0)."""
    from tools.exercises import command

    if hint and solution:
        raise UserError("--hint or --solution? One at a time.")
    return command.check(folder, hint=hint, solution=solution)
