"""`strata diff` in the terminal: files in the order of reading, changed functions with their lines, and counts.

Where two versions are compared and there is room, they stand side by side.
"""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from common.names import visible
from common.reports.tables import table
from tools.diff.diff import FileDifference, Hunk, Line
from tools.diff.lesson import Comparison, count

WIDE = 150
"""Columns from which on two versions stand side by side."""

STYLES = {"+": "green", "-": "red", " ": ""}
MINOR = ("constant", "block")
"""Kinds of definitions that say little of a new file."""
SIGNS = {"new": "+", "removed": "-", "changed": "~"}


def show(made: Comparison, to: Console, everything: bool = False) -> None:
    """Print what differs; `everything` unfolds plumbing, and prints new files whole."""
    if made.nothing:
        _line(to, made.nothing)
        return
    _line(to, made.title, "bold")
    _line(to, made.totals())
    for file in made.ideas:
        show_file(made, file, to, everything)
    if everything:
        for file in made.plumbing:
            show_file(made, file, to, everything)
        return
    for why, files in made.folded():
        insertions, deletions = (sum(getattr(f, name) for f in files) for name in ("insertions", "deletions"))
        names = ", ".join(f"{made.where(f)} ({made.status(f)})" for f in files)
        _line(to, "")
        _line(to, f"Folded, {why}: {len(files)}, {count(insertions, deletions)}; --all unfolds", "bold")
        _line(to, f"  {names}")


def show_stat(made: Comparison, to: Console) -> None:
    """Print one row for each file that differs, in the order of reading, and the sum."""
    if made.nothing:
        _line(to, made.nothing)
        return
    printed = table(made.title, "file", "what", ">+", ">-", "functions")
    for file in (*made.ideas, *made.plumbing):
        told = sorted(file.functions, key=lambda one: one.kind in MINOR)
        names = ", ".join(f"{SIGNS[one.status]}{one.name}" for one in told[:4])
        more = f", {len(file.functions) - 4} more" if len(file.functions) > 4 else ""
        cells = (made.where(file), made.status(file), str(file.insertions), str(file.deletions), names + more)
        printed.add_row(*(Text(visible(cell)) for cell in cells))
    to.print(printed)
    _line(to, made.totals())


def show_file(made: Comparison, file: FileDifference, to: Console, everything: bool) -> None:
    """Print what a file is, what changed in it, and its lines."""
    _line(to, "")
    head = Text(visible(made.where(file)), "bold cyan")
    head.append(f"  {made.status(file)}  ", "bold")
    head.append(count(file.insertions, file.deletions))
    to.print(head, soft_wrap=True)
    if file.sentence:
        _line(to, file.sentence, "italic")
    for note in made.notes(file):
        _line(to, note, "yellow")
    alone = file.status in ("new", "removed")
    for one in file.functions:
        if alone and one.kind in MINOR:
            continue
        counts = f"{one.insertions or one.deletions} lines" if alone else count(one.insertions, one.deletions)
        said = "" if alone or one.status == "changed" else f", {one.status}"
        _line(
            to,
            f"  {SIGNS[one.status]} {one.kind} {one.name}{said}  {counts}",
            STYLES.get(SIGNS[one.status], ""),
        )
    if alone and not everything:
        return
    imports = [] if everything or file.imports_only else [hunk for hunk in file.hunks if hunk.imports_only]
    if imports:
        _line(to, f"  imports, folded: {len(imports)}; --all unfolds")
    for hunk in file.hunks:
        if hunk in imports:
            continue
        if made.versions and to.width >= WIDE and not alone:
            _show_beside(hunk, to)
        else:
            _show_hunk(hunk, to)


def _show_hunk(hunk: Hunk, to: Console) -> None:
    _line(to, heading(hunk), "cyan")
    for line in hunk.lines:
        _line(to, f"{line.mark} {line.text.expandtabs(4)}".rstrip(), STYLES[line.mark])


def _show_beside(hunk: Hunk, to: Console) -> None:
    _line(to, heading(hunk), "cyan")
    grid = Table.grid(padding=(0, 1), expand=True)
    for _ in range(2):
        grid.add_column(width=6)
        grid.add_column(ratio=1, overflow="fold")
    for left, right in hunk.rows():
        grid.add_row(*_cells(left, "old"), *_cells(right, "new"))
    to.print(grid)


def _cells(line: Line | None, side: str) -> tuple[Text, Text]:
    if line is None:
        return Text(), Text()
    number = line.old if side == "old" else line.new
    return (
        Text.assemble((f"{number:>4} ", "dim"), (line.mark, STYLES[line.mark])),
        Text(visible(line.text.expandtabs(4)), STYLES[line.mark]),
    )


def heading(hunk: Hunk) -> str:
    """Return where a hunk is: the line at which it begins, and the definition that it lies in."""
    first = hunk.lines[0]
    name = f", {hunk.within}" if hunk.within else ""
    return f"@@ line {first.new or first.old}{name}"


def _line(to: Console, text: str, style: str = "") -> None:
    to.print(Text(visible(text), style), soft_wrap=True)
