"""The look of every table of the command line."""

from __future__ import annotations

from rich import box
from rich.markup import escape
from rich.table import Table

from backends.contract import Plan


def table(title: str, *columns: str) -> Table:
    """Return an empty table; the title is taken as it is, and a column whose name begins with ">" is aligned right."""
    made = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        right = column.startswith(">")
        made.add_column(column.removeprefix(">"), justify="right" if right else "left", overflow="fold")
    return made


def plan_table(plan: Plan, device: str) -> Table:
    """Return which path each feature takes on `device`, and why."""
    made = table(f"Plan on {device}", "feature", "path", "why")
    for choice in plan.choices:
        made.add_row(choice.feature, choice.path, choice.reason)
    return made
