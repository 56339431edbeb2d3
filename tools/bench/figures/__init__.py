"""The figures of a bench's record one by one, each with its name, its kind and its noise: what two records share.

A figure is named by its part, its point and a word: ("settings", "medium", "gpu_ms"), ("scales", "draws, 1000, chapter
1", "work draws"). Its noise is what the record says of it, half the distance of the quartiles; None where it says
nothing. What says how something was drawn, and not what it cost, as the number of samples, is of the kind "fact".
"""

from __future__ import annotations

from typing import Any

from tools.bench.figures import lessons, own
from tools.bench.figures.kinds import Figure, Key

PARTS = {**own.PARTS, **lessons.PARTS}
"""How the points of each part of a bench are found in its record."""

__all__ = ["PARTS", "Figure", "Key", "figures", "settings"]


def figures(made: dict[str, Any]) -> dict[Key, Figure]:
    """Return the figures of a record. Raises KeyError, TypeError or AttributeError for what is no whole record."""
    found: dict[Key, Figure] = {}
    for part, rows in PARTS.items():
        for point, figure in rows(made):
            found |= {(part, point, name): one for name, one in figure.items() if one is not None}
    return found


def settings(made: dict[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the settings of each (part, point) that has some: a point of other settings is another point."""
    found = {("settings", one["name"]): dict(one["settings"]) for one in made["points"]}
    for swept in made["prepared"]:
        for one in swept["points"]:
            found["prepared", f"{swept['name']}, {one['name']}"] = dict(one["settings"])
    return found
