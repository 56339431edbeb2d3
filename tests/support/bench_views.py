"""What a part of a bench prints and draws from its record."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console


def shown(module: Any, record: Any, width: int = 180) -> str:
    """Return what is printed, on a console of so many columns."""
    console = Console(file=(text := io.StringIO()), width=width)
    module.show(record, console)
    return text.getvalue()


def drawn(module: Any, record: Any) -> list[str]:
    """Return the labels of the lines of a plot."""
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    module.plot(axes, record)
    return axes.get_legend_handles_labels()[1]
