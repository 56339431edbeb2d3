"""`strata diff A B`: what one chapter adds to another, in the terminal or as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from common.errors import UserError
from common.paths import write_whole, written_file
from tools.cli.console import Steps, out, say
from tools.cli.stopping import prompt_stop
from tools.diff import terminal
from tools.diff.lecture import Stop, stops_of
from tools.diff.lesson import Comparison, compare
from tools.diff.sides import tree_of


def run(
    a: str,
    b: str,
    *,
    stat: bool = False,
    html: Path | None = None,
    only: tuple[str, ...] = (),
    everything: bool = False,
    pictures: bool | None = None,
    lecture: bool = False,
) -> int:
    """Print the difference of two sides, or write its page; return the exit code. Raises UserError."""
    if html is not None:
        check_page(html)
    elif pictures:
        raise UserError("--pictures are for a page: write one with --html FILE.")
    if lecture:
        others = {"--only": bool(only), "--all": everything, "--stat": stat}
        wrong = [name for name, given in others.items() if given]
        if wrong:
            raise UserError(f"--lecture is a page with stops of its own: leave {wrong[0]} out.")
        if html is None:
            raise UserError("--lecture is a page of its own: strata diff 3 4 --lecture --html FILE.")
        if "@" in a + b:
            raise UserError("A lecture is on all of a chapter: leave the @ of both sides out.")
    made = compare(tree_of(a), tree_of(b), only)
    if html is not None:
        stops = lecture_of(made) if lecture else []
        with prompt_stop():
            write_page(made, html, pictures is not False, stops)
    if stat:
        terminal.show_stat(made, out)
    elif html is None:
        terminal.show(made, out, everything)
    return 0


def check_page(path: Path) -> None:
    """Raise UserError where a page cannot be written to `path`: before anything is drawn for it."""
    target = written_file(path.absolute())
    if target.is_dir():
        raise UserError(f"--html {path} is a folder: name the file to write, such as {path / 'diff.html'}.")
    if target.suffix.lower() not in (".html", ".htm"):  # it might be the very file that was changed
        raise UserError(f"--html {path} is no name of a page: it must end in .html.")
    if not target.parent.is_dir():
        raise UserError(f"--html {path} cannot be written: there is no folder {target.parent}.")


def lecture_of(made: Comparison) -> list[Stop]:
    """Return the stops on what a chapter adds to the one before; raise UserError for other sides."""
    number = made.b.number
    if number is None or made.a.number != number - 1 or not made.b.folder.is_dir():
        raise UserError(
            "A lecture is on a chapter and the one before it: strata diff 3 4 --lecture --html FILE."
        )
    return stops_of(made.b.folder)


def write_page(made: Comparison, path: Path, pictures: bool, stops: Sequence[Stop] = ()) -> None:
    """Write the page; raise UserError where the disk refuses."""
    from tools.diff.page import page
    from tools.diff.pictures import Pictures, draw

    with Steps() as steps:
        shown = draw(made, steps) if pictures else Pictures()
        steps("write", 0.95)
        text = page(made, shown, stops)
    try:
        write_whole(path.absolute(), text.encode())
    except OSError as error:
        raise UserError(f"--html {path} cannot be written: {error.strerror or error}.") from None
    said = made.nothing or f"{made.title}: {made.totals()}"
    say(f"{said} Wrote {path}")
