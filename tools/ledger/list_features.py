"""`strata list --features`: every feature, the tests that hold it, and what became of them on each backend."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape

import chapters
from common.errors import UserError
from common.reports.tables import table
from tools.cli.console import out
from tools.ledger import features, results
from tools.ledger.features import Feature
from tools.ledger.results import BACKENDS, Area

HEADS = {"vulkan": "Vulkan", "without-all": "w/o all", "gl": "OpenGL", "cpu": "CPU"}
"""Short enough for 80 columns; "w/o all" is Vulkan with `--without all`."""
LOOK = {"failed": "bold red", "not run": "yellow", "no test": "yellow"}


def run(chapter: str | None, find: str, *, tests: bool, as_json: bool) -> int:
    """Print the features of a chapter, or all, whose name or tests have the words of `find`; return the exit code.

    With `tests`, the names of the tests too. Raises UserError where nothing is found.
    """
    number = None if chapter is None else _number(chapter)
    rows = features.ledger()
    every = [one for one in features.features(rows) if number is None or number in one.chapters]
    found = [one for one in every if one.matches(find)]
    if not found:
        where = "" if number is None else f" of chapter {number}"
        what = (
            f"No feature{where} has {find!r} in its name or its tests"
            if find
            else f"No feature{where} is here"
        )
        raise UserError(f"{what}: ./strata list --features shows all.")
    record = results.newest(results.read(), results.read(results.own_path()))
    if as_json:
        print(json.dumps(data(found, record), indent=1))
    else:
        _show(found, record, tests, sum(not features.here(row) for row in rows.values()))
    return 0


def _number(chapter: str) -> int:
    which = chapters.parse_chapter(chapter)
    if not isinstance(which, int):
        raise UserError("--features takes the number of a chapter: tests of a fork are those of its chapter.")
    return which


# --- the table --------------------------------------------------------------------------------------------------------


def _show(found: Sequence[Feature], record: Mapping[str, Area], tests: bool, to_come: int) -> None:
    if tests:
        for one in found:
            out.print(f"[bold]{escape(one.slug)}[/bold]", soft_wrap=True)
            for line in _lines(one, record):
                out.print(f"  {line}", markup=False, soft_wrap=True)
        out.print()
    else:
        made = table("Features and their tests", "feature", ">tests", *HEADS.values())
        made.padding = (0, 1, 0, 0)
        for title, group in features.grouped(found).items():
            made.add_section()
            made.add_row(f"[bold]{escape(title)}[/bold]")
            for one in group:
                cells = [features.state(one, backend, record) for backend in HEADS]
                looks = [f"[{LOOK[cell]}]{cell}[/]" if cell in LOOK else cell or "-" for cell in cells]
                made.add_row(escape(one.slug), str(len(one.tests)), *looks)
        out.print(made)
    for line in _legend(found, record, to_come):
        out.print(line, markup=False, soft_wrap=True)


def _lines(one: Feature, record: Mapping[str, Area]) -> list[str]:
    """Return a feature's title, what became of its tests on each backend, and their names."""
    title = [one.row.title] if one.row else []
    counts = features.states(one, record)
    shown = {b: results.said(counts[b]) if b in counts else features.state(one, b, record) for b in BACKENDS}
    by_words: dict[str, list[str]] = defaultdict(list)
    for backend, words in shown.items():
        if words:
            by_words[words].append(BACKENDS[backend])
    went = "; ".join(f"{', '.join(names)}: {words}" for words, names in by_words.items())
    return [*title, went, *(test.name for test in one.tests)]


def _legend(found: Sequence[Feature], record: Mapping[str, Area], to_come: int) -> list[str]:
    """Return what stands below the table: of which runs the results are, and what is missing."""
    areas = {area for one in found for area in one.areas}
    areas |= {name for name, area in record.items() if any(one.slug in area.features for one in found)}
    by_run: dict[str, list[str]] = defaultdict(list)
    for name in sorted(areas & {*record}):
        by_run[record[name].run.when].append(name)
    lines = []
    for when in sorted(by_run, reverse=True):
        run = record[by_run[when][0]].run
        devices = "; ".join(dict.fromkeys(run.devices[b] for b in BACKENDS if b in run.devices))
        lines.append(
            f"Results of {when[:16].replace('T', ' ')} UTC, commit {run.commit}: {', '.join(by_run[when])}."
        )
        lines.append(f"  {devices}.")
    missing = sorted(areas - {*record})
    if missing:
        lines.append(f"Never run: {', '.join(missing)}. {features.run_command(missing)} does it.")
    if any(not one.tests for one in found):
        count = sum(not one.tests for one in found)
        lines.append(f"{count} of them have no test yet.")
    if to_come:
        lines.append(f"{to_come} more belong to chapters that are still to come.")
    return lines


# --- JSON -------------------------------------------------------------------------------------------------------------


def data(found: Sequence[Feature], record: Mapping[str, Area]) -> dict[str, Any]:
    """Return features with their tests, states and results by area, and the runs that the results are of."""
    used = {name for name, area in record.items() if any(one.slug in area.features for one in found)}
    runs = {record[name].run.when: record[name].run for name in sorted(used)}
    return {
        "backends": dict(BACKENDS),
        "features": [_one(feature, record) for feature in found],
        "runs": {
            when: {"commit": run.commit, "devices": dict(run.devices), "long": run.long}
            for when, run in sorted(runs.items())
        },
    }


def _one(feature: Feature, record: Mapping[str, Area]) -> dict[str, Any]:
    row, counts = feature.row, features.states(feature, record)
    held = {name: area for name, area in record.items() if feature.slug in area.features}
    return {
        "feature": feature.slug,
        **({"title": row.title, "home": row.home, "wanted_on": list(row.backends)} if row else {}),
        "chapters": list(feature.chapters),
        "tests": [test.name for test in feature.tests],
        "state": {backend: features.state(feature, backend, record) or None for backend in BACKENDS},
        "counts": {backend: dict(one) for backend, one in counts.items()},
        "areas": {
            name: {"run": area.run.when, **{b: dict(c) for b, c in area.features[feature.slug].items()}}
            for name, area in held.items()
        },
    }
