"""Sentences below the panels of a plot."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import Any

SIZE = 7.0
"""Of the letters, in points of 1/72 inch."""

WIDTH = 0.58
"""Of a letter, as a part of its size; more than the mean of matplotlib's own font."""


def write_below(figure: Any, sentences: Iterable[str]) -> None:
    """Write sentences below all panels of a figure with constrained layout, which makes room for them.

    Each begins a line, and is broken where the figure ends.
    """
    letters = int(0.96 * figure.get_figwidth() * 72 / (WIDTH * SIZE))
    lines = [line for sentence in sentences for line in textwrap.wrap(sentence, letters)]
    if lines:
        figure.supxlabel("\n".join(lines), fontsize=SIZE, x=0.02, horizontalalignment="left")
