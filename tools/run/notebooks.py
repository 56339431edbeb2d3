"""Notebooks without Jupyter: their cells, and what each of them shows when all are run in order.

for cell in run(read(path)):
    cell.kind, cell.text, cell.shown
"""

from __future__ import annotations

import ast
import json
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from html import escape
from io import TextIOBase
from pathlib import Path
from typing import Any

from common.errors import UserError
from tools.run.shown import displaying


@dataclass
class Cell:
    """One cell: its text, and of code what it has shown, as HTML in the order in which it came."""

    kind: str
    """ "code" or "markdown"."""
    text: str
    shown: list[str] = field(default_factory=list)


class _Printed(TextIOBase):
    """A stdout whose text goes below a cell."""

    def __init__(self, shown: list[str]) -> None:
        self._shown = shown
        self._last = -1  # where in `shown` the text is that is still being printed

    def write(self, text: str) -> int:
        said = escape(text)
        if self._last == len(self._shown) - 1 >= 0:
            self._shown[-1] = self._shown[-1].removesuffix("</pre>") + said + "</pre>"
        else:
            self._shown.append(f"<pre>{said}</pre>")
            self._last = len(self._shown) - 1
        return len(text)


def read(path: Path) -> list[Cell]:
    """Return the cells of a notebook's file, none of them run; raise UserError for what is no notebook."""
    try:
        found = json.loads(path.read_text("utf-8"))["cells"]
        return [Cell(cell["cell_type"], "".join(cell["source"])) for cell in found]
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UserError(f"{path} is no notebook ({type(error).__name__}: {error}).") from None


def run(cells: list[Cell]) -> dict[str, Any]:
    """Run the cells of code in one namespace, note what each shows, and return the namespace.

    As in Jupyter, a cell that ends with an expression shows its value, unless that is None. What a cell raises goes on.
    """
    space: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells, start=1):
        if cell.kind != "code":
            continue
        name, tree = f"cell {number}", ast.parse(cell.text)
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        cell.shown = []

        def display(value: Any, to: list[str] = cell.shown) -> None:
            ask = getattr(value, "_repr_mimebundle_", None)
            to.append(f"<pre>{escape(repr(value))}</pre>" if ask is None else ask()["text/html"])

        with displaying(display), redirect_stdout(_Printed(cell.shown)):
            exec(compile(tree, name, "exec"), space)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), name, "eval"), space)
                if value is not None:
                    display(value)
    return space
