"""What a comparison of two records says: tables of what changed, sentences on what cannot be compared, and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from common.reports.tables import table
from tools.bench.figures import Figure

if TYPE_CHECKING:
    from tools.bench.compare import Change, Comparison, Whole

MOST = 20
"""Rows of a table of what is no regression; the JSON has all."""

MANY = 10
"""A figure that became so many times as large is said to be so many times as large, not by a percentage."""

OF_CHANGE = 0.1
"""A part of a sum is named if it moved by so much of what the sum moved."""

WORDS = {
    ("time", "worse"): "slower",
    ("time", "better"): "faster",
    ("error", "worse"): "less true",
    ("error", "better"): "truer",
    ("work", "worse"): "more work",
    ("work", "better"): "less work",
}


def show(found: Whole, to: Console) -> None:
    """Print a comparison: what became worse first, and its count last."""
    for note in found.notes:
        _say(to, note)
    for one in found.comparisons:
        _show(one, to)
    for sentence in found.failing:
        _say(to, f"Regression: {sentence}")
    count = found.regressions
    if count or not found.in_vain:
        _say(
            to,
            f"{count or 'No'} regression{'' if count == 1 else 's'} among {found.compared:,} figures that both have.",
        )
    else:
        _say(to, "Nothing was compared: the two have no figure in common that counts.")


def _say(to: Console, text: str) -> None:
    to.print(text, soft_wrap=True, markup=False)


def _show(found: Comparison, to: Console) -> None:
    name = f"Chapter {found.chapter} on {found.backend}"
    for sentence in found.apart:
        _say(to, f"{name}: {sentence}")
    of = {
        word: [one for one in found.changes if one.verdict == word] for word in ("worse", "better", "other")
    }
    _table(f"{name}: regressions", found.regressions, to, len(found.regressions))
    spared = [one for one in of["worse"] if one not in found.regressions]
    _table(f"{name}: worse, and not for the code alone, as said above", spared, to)
    _table(f"{name}: improvements", of["better"], to)
    _table(f"{name}: neither better nor worse, but another number", of["other"], to)
    for place, figures in (("first", found.only_old), ("second", found.only_new)):
        for part, point, names in figures[:MOST]:
            _say(to, f"{name}: only in the {place} record: {', '.join(filter(None, (part, point, names)))}.")
        if len(figures) > MOST:
            _say(to, f"{name}: and {len(figures) - MOST} more only in the {place} record; --json has all.")


def _table(title: str, changes: Sequence[Change], to: Console, most: int = MOST) -> None:
    if not changes:
        return
    shown = table(title, "figure", ">old", ">new", ">change", "")
    for change in sorted(changes, key=lambda one: -_grown(one))[:most]:
        word = WORDS.get((change.old.kind, change.verdict), "")
        shown.add_row(
            ", ".join(change.key),  # one column: three would each break within words on a narrow terminal
            _cell(change.old),
            _cell(change.new),
            _change(change),
            f"{word}{_within(change)}",
        )
    to.print(shown)
    if len(changes) > most:
        _say(to, f"And {len(changes) - most} more of these; --json has all.")


def _cell(one: Figure) -> str:
    noise = f" ±{one.noise:.2g}" if one.noise is not None else ""
    whole = one.kind in ("work", "fact") and math.isfinite(one.value)
    return _whole(one.value) if whole else f"{one.value:.4g}{noise}"


def _grown(change: Change) -> float:
    """Return how far a figure moved, as a logarithm: to and from 0, and to and from no number, are farthest."""
    old, new = change.old.value, change.new.value
    if not (math.isfinite(old) and math.isfinite(new)) or old * new <= 0:
        return math.inf
    return abs(math.log(abs(new)) - math.log(abs(old)))


def _change(change: Change) -> str:
    old, new = change.old.value, change.new.value
    if not (math.isfinite(old) and math.isfinite(new)) or old <= 0 or new < 0:
        return "-"
    times = new / old
    return f"{times - 1:+.1%}" if times < MANY else f"x {_whole(times)}"


def _whole(value: float) -> str:
    """Return a whole number with all its digits, as far as a float has them."""
    return f"{value:,.0f}" if abs(value) < 1e15 else f"{value:.3g}"


def _within(change: Change) -> str:
    """Return which part of a sum moved most, where it did: ": gbuffer +29.1"."""
    moved = {
        name: change.new.within.get(name, 0.0) - change.old.within.get(name, 0.0)
        for name in {**change.old.within, **change.new.within}
    }
    if len(moved) < 2 or change.verdict not in ("worse", "better"):
        return ""
    sign = 1 if change.verdict == "worse" else -1
    name = max(moved, key=lambda one: sign * moved[one])
    share = sign * moved[name] / abs(change.new.value - change.old.value)
    return f": {name} {moved[name]:+.3g}" if share > OF_CHANGE else ""


def record(found: Whole) -> dict[str, Any]:
    """Return a comparison as JSON has it."""

    def side(figure: Figure) -> dict[str, Any]:
        return {"value": figure.value, "noise": figure.noise, "least": figure.least}

    return {
        "kind": "comparison of benches",
        "old": str(found.old),
        "new": str(found.new),
        "regressions": found.regressions,
        "notes": found.notes,
        "failing": found.failing,
        "comparisons": [
            {
                "chapter": one.chapter,
                "backend": one.backend,
                "compared": one.compared,
                "blames": sorted(one.blames),
                "apart": one.apart,
                "changes": [
                    {
                        **dict(zip(("part", "point", "figure"), change.key, strict=True)),
                        "kind": change.old.kind,
                        "verdict": change.verdict,
                        "old": side(change.old),
                        "new": side(change.new),
                    }
                    for change in one.changes
                ],
                "only_old": [" / ".join(filter(None, words)) for words in one.only_old],
                "only_new": [" / ".join(filter(None, words)) for words in one.only_new],
            }
            for one in found.comparisons
        ],
    }
