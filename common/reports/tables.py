"""The look of every table that is printed."""

from __future__ import annotations

from rich import box
from rich.markup import escape
from rich.table import Table


def table(title: str, *columns: str) -> Table:
    """Return an empty table; the title is taken as it is, and a column whose name begins with ">" is aligned right."""
    made = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        right = column.startswith(">")
        made.add_column(column.removeprefix(">"), justify="right" if right else "left", overflow="fold")
    return made
