"""The options of `strata next`; what it does is in `tools.lessons.next`."""

from __future__ import annotations

from typing import Annotated

import typer

from common.errors import UserError


def next_(
    chapter: Annotated[
        str | None, typer.Argument(metavar="[N]", help="Go to this chapter.", show_default=False)
    ] = None,
    done: Annotated[
        bool, typer.Option("--done", help="The section is read: go on without its exercise.")
    ] = False,
    everything: Annotated[bool, typer.Option("--all", help="List all sections and what is solved.")] = False,
    forget: Annotated[bool, typer.Option("--forget", help="Delete what is kept of your progress.")] = False,
) -> int:
    """Show where you are in the lessons, what comes next, and which exercises you have solved."""
    import chapters
    from tools.lessons import next as lessons

    if sum((chapter is not None, done, forget)) > 1 or (forget and everything):
        raise UserError("A chapter, --done or --forget? One at a time.")
    number = None if chapter is None else chapters.parse_chapter(chapter)
    if number is not None and not isinstance(number, int):
        raise UserError(f"{number} is a fork: lessons belong to chapters, as `strata next 1`.")
    return lessons.run(number, done=done, everything=everything, forget=forget)
