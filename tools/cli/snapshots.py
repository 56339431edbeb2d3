"""The options of `strata carry`, `new` and `fork`; what they do is in `tools.snapshots`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.errors import UserError


def carry(
    chapter: Annotated[
        str | None,
        typer.Argument(metavar="N", help="The chapter with the fix: 3, or ch03.", show_default=False),
    ] = None,
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE", help="Its files that were mended, or folders of them.", show_default=False
        ),
    ] = None,
    base: Annotated[
        str, typer.Option(metavar="COMMIT", help="The chapter before the fix; HEAD~1 if that is committed.")
    ] = "HEAD",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would happen, and write nothing.")
    ] = False,
    go_on: Annotated[bool, typer.Option("--continue", help="Go on, once a conflict is resolved.")] = False,
    abort: Annotated[bool, typer.Option("--abort", help="Take a carry that waits back.")] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Name lines repaired in one chapter and still broken in a later one."),
    ] = False,
) -> int:
    """Take a fix made in chapter N to all later ones by three-way merge, up to the first conflict."""
    import chapters
    from tools.snapshots import carry as carrying
    from tools.snapshots import carry_check

    ways = [name for name, given in (("--continue", go_on), ("--abort", abort), ("--check", check)) if given]
    if len(ways) > 1 or (ways and chapter is not None):
        raise UserError(f"`strata carry {ways[0]}` stands alone.")
    if dry_run and (abort or check):
        raise UserError(f"`strata carry {ways[0]}` has no --dry-run.")
    if go_on:
        return carrying.resume(chapters.FOLDER, dry_run=dry_run)
    if abort:
        return carrying.abort(chapters.FOLDER)
    if check:
        return carry_check.run(chapters.FOLDER)
    if chapter is None:
        raise UserError(
            "Which chapter has the fix? `strata carry ch03 shading/forward.py` takes it to the later ones."
        )
    return carrying.start(chapters.FOLDER, _number(chapter), files or [], base=base, dry_run=dry_run)


def new(
    title: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="What the chapter is about, in a few words.", show_default=False),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Also if the last chapter is not finished or not committed.")
    ] = False,
) -> int:
    """Make the next chapter as a byte copy of the last one, with a lesson to be written."""
    import chapters
    from tools.snapshots import new_chapter

    return new_chapter.run(chapters.FOLDER, title, force=force)


def fork(
    chapter: Annotated[
        str | None,
        typer.Argument(
            metavar="N", help="Number of the chapter: 3, or ch03; or one of its studies.", show_default=False
        ),
    ] = None,
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="A new folder, anywhere.", show_default=False)
    ] = None,
    update: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Bring later fixes of its chapter into this fork.", show_default=False
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="With --update: say what would happen, and write nothing.")
    ] = False,
    studies: Annotated[
        bool, typer.Option("--studies", help="Copy the chapter's studies and benches, too.")
    ] = False,
) -> int:
    """Make a copy of a chapter that is yours to change, or bring later fixes of the chapter into it."""
    from tools.snapshots import fork_update, forks

    if update is not None:
        if chapter is not None or studies:
            raise UserError("`strata fork --update DIR` takes nothing else but --dry-run.")
        return fork_update.update(update, dry_run=dry_run)
    if dry_run:
        raise UserError("--dry-run is for `strata fork --update DIR`.")
    if chapter is None or folder is None:
        raise UserError("Name a chapter and a folder: `strata fork 1 my-ch01`.")
    number, study = _number_and_study(chapter)
    return forks.run(number, folder, studies=studies or bool(study), study=study)


def _number(text: str) -> int:
    """Return the number of the chapter that is meant; raise UserError for a study or a fork."""
    import chapters

    number, study = _number_and_study(text)
    if study:
        chapters.parse_chapter(text)  # says that a study is no chapter
    return number


def _number_and_study(text: str) -> tuple[int, str]:
    """Return the chapter and the name of the study that are meant, "" for none; raise UserError for a fork."""
    import chapters
    from chapters import studies

    which = chapters.parse(text)
    owner, study = studies.split(which) if isinstance(which, str) else (which, "")
    if not isinstance(owner, int):
        raise UserError(
            f"{text} is a copy of a chapter, and this is about the chapters of the clone: write a number."
        )
    return owner, study
