"""A process that looks like a notebook's: what IPython is asked for, and what it is given to display."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import pytest


class Kernel:
    """What `IPython.get_ipython()` returns below a cell; a terminal's is of another class."""


class TerminalInteractiveShell:
    """The same of IPython in a terminal, by its name."""


@dataclass
class Displayed:
    """What was displayed, as bundles of content by type."""

    bundles: list[dict[str, str]] = field(default_factory=list)

    def __call__(self, shown: Any) -> None:
        """Ask an object as IPython does."""
        self.bundles.append(shown._repr_mimebundle_(include=None, exclude=None))


def install(monkeypatch: pytest.MonkeyPatch, shell: object | None) -> Displayed:
    """Let this process look like one that IPython runs in `shell`; return what gets all that is displayed."""
    displayed = Displayed()
    package, module = ModuleType("IPython"), ModuleType("IPython.display")
    package.get_ipython = lambda: shell  # type: ignore[attr-defined]
    module.display = displayed  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    return displayed
