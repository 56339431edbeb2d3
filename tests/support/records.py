"""What is kept of a run of tests: the results of each area that was run as a whole (`tools.ledger.results`).

An area is whole when all its files were collected and nothing but our own rules left tests out. That of a chapter needs
the files of all chapters before it, whose tests it has to pass too. What was run in part keeps what was known of it.
"""

from __future__ import annotations

import platform
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

from common.paths import ROOT
from tools.ledger import features
from tools.ledger.results import Area, Run

PARTIAL = {"keyword": "-k", "markexpr": "-m", "deselect": "--deselect", "lf": "--lf", "stepwise": "--sw"}
"""Options of pytest that leave tests out of every area."""
VARIANTS = {"vulkan": "vulkan", "deferred": "vulkan", "without-all": "without-all", "gl": "gl"}
"""What a test may be run for, and on which backend that is; "deferred" is another path of a frame there."""
FIXTURES = {"vulkan_device": "vulkan", "vulkan_instance": "vulkan", "gl_context": "gl"}
"""Fixtures that open a device for tests that are run for no variant."""


def backends_of(item: Any) -> tuple[str, ...]:
    """Return the backends that a test runs on, as `tools.ledger.results` names them; "cpu" if it opens no device.

    The mark `runs_on` names them where a test opens its devices itself, or has another process do that.
    """
    parameters = getattr(getattr(item, "callspec", None), "params", {})
    named = [VARIANTS[value] for value in parameters.values() if isinstance(value, str) and value in VARIANTS]
    named += [backend for mark in item.iter_markers("runs_on") for backend in mark.args]
    used = {*getattr(item, "fixturenames", ())}
    named += [
        FIXTURES[name] for name in FIXTURES if name in used and not (named and name == "vulkan_instance")
    ]
    if "without-all" in named:  # the device that its fixture opens is that one
        named = [one for one in named if one != "vulkan"]
    return tuple(dict.fromkeys(named)) or ("cpu",)


def cpu() -> str:
    """Return what tests without a device run on."""
    return f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"


def files_there(root: Path = ROOT) -> list[str]:
    """Return all files of tests."""
    return [path.relative_to(root).as_posix() for path in (root / "tests").rglob("test_*.py")]


def files_of(area: str, files: Iterable[str]) -> set[str]:
    """Return those of all files of tests that belong to an area; to a chapter's belong those of chapters before it."""
    chapter = re.fullmatch(r"ch(\d\d)", area)
    areas = {f"ch{number:02d}" for number in range(1, int(chapter[1]) + 1)} if chapter else {area}
    return {file for file in files if features.area_of(file) in areas}


def whole_areas(
    collected: Collection[str], subjects: Collection[str], every: Collection[str]
) -> dict[str, str]:
    """Return the areas that a run touched: "" for one that it has as a whole, else why not.

    `collected` are its files, `every` all there are, `subjects` the chapters that tests of chapters were run for.
    """
    found = {}
    areas = {area for area in map(features.area_of, collected) if not re.fullmatch(r"ch\d\d", area)}
    for area in sorted(areas | {*subjects}):
        wanted = files_of(area, every)
        missing = wanted - {*collected}
        if missing != wanted:
            found[area] = f"{len(missing)} of its {len(wanted)} files were not run" if missing else ""
    return found


def why_partial(config: pytest.Config) -> str:
    """Return a sentence on the option or argument that leaves tests out of any area; "" if there is none."""
    given = [name for option, name in PARTIAL.items() if getattr(config.option, option, None)]
    given += [word for word in config.args if "::" in word]
    return f"{given[0]} leaves tests out" if given else ""


def areas_of(
    outcomes: Iterable[Any],
    skipped: Mapping[str, str],
    whole: Collection[str],
    run: Run,
    root: Path = ROOT,
) -> dict[str, Area]:
    """Return the results of the areas `whole`, without those of which a test was not run.

    An outcome has area, backends, result and features, and counts as a test of the first of its backends; `skipped` are
    files that were left at their import, with why.
    """
    tests: dict[str, dict[str, Counter[str]]] = defaultdict(lambda: defaultdict(Counter))
    held: dict[str, dict[str, dict[str, Counter[str]]]] = defaultdict(
        lambda: defaultdict(lambda: defaultdict(Counter))
    )
    unfinished = set()
    for one in outcomes:
        if one.result == "not run":
            unfinished.add(one.area)
        tests[one.area][one.backends[0]][one.result] += 1
        for slug in one.features:
            for backend in one.backends:
                held[one.area][slug][backend][one.result] += 1
    for file in skipped:
        area = features.area_of(file)
        for slugs in features.marked(root / file).values():
            for slug in slugs:
                held[area][slug]["cpu"]["skipped"] += 1
        tests[area]["cpu"]["skipped"] += 1
    return {
        area: Area(
            run,
            {backend: dict(counts) for backend, counts in tests[area].items()},
            {slug: {b: dict(c) for b, c in by_backend.items()} for slug, by_backend in held[area].items()},
        )
        for area in sorted(tests)
        if area in whole and area not in unfinished
    }
