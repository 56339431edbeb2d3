"""What became of the tests, by area of tests/, backend and feature: how a record of that is read and merged.

    docs/records/tests.json        what the site shows: `./strata test --record` writes it
    CACHE/tests/results.json       the same of this machine: every run of whole areas leaves it

    {"format": 1,
     "runs": {"2026-01-02T03:04:05+00:00": {"commit": ..., "devices": {"vulkan": ..., "gl": ..., "cpu": ...}}},
     "areas": {"ch01": {"run": "2026-01-02T03:04:05+00:00",
                        "tests": {"vulkan": {"passed": 412, "skipped": 1}},
                        "features": {"textures/mip-maps": {"vulkan": {"passed": 4}}}}}}

An area has one line for its tests and one for each feature: what two records differ in is seen at a glance.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.paths import ROOT, cache_dir, user_cache, write_whole

RECORD = ROOT / "docs" / "records" / "tests.json"
FORMAT = 1
BACKENDS = {"vulkan": "Vulkan", "without-all": "Vulkan without options", "gl": "OpenGL", "cpu": "CPU"}
"""What tests run on, with how it is called; "cpu" are those that open no device, "without-all" is `--without all`."""

Counts = Mapping[str, int]
"""How many tests "passed", "failed" and were "skipped"."""


@dataclass(frozen=True)
class Run:
    """One run of tests: the time of its end (UTC, ISO 8601), the commit, and the device of each backend."""

    when: str
    commit: str
    devices: Mapping[str, str]
    long: bool = False


@dataclass(frozen=True)
class Area:
    """What became of the tests of an area, and of those among them that hold a feature, by backend."""

    run: Run
    tests: Mapping[str, Counts]
    features: Mapping[str, Mapping[str, Counts]]


def read(path: Path = RECORD) -> dict[str, Area]:
    """Return the areas of a record by name; {} where there is none, or none that can be read."""
    try:
        found = json.loads(path.read_text("utf-8"))
        if found["format"] != FORMAT:
            return {}
        runs = {when: Run(when, **one) for when, one in found["runs"].items()}
        areas = found["areas"].items()
        return {name: Area(runs[one["run"]], one["tests"], one["features"]) for name, one in areas}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def own_path() -> Path:
    """Return where the results of this machine are."""
    return user_cache() / "tests" / "results.json"


def newest(*records: Mapping[str, Area]) -> dict[str, Area]:
    """Return of each area the result of the last run."""
    found: dict[str, Area] = {}
    for record in records:
        for name, area in record.items():
            if name not in found or area.run.when >= found[name].run.when:
                found[name] = area
    return dict(sorted(found.items()))


def keep(areas: Mapping[str, Area], there: Iterable[str], path: Path = RECORD) -> None:
    """Write areas into a record; others stay, unless they are not among those that are `there` any more."""
    names = {*there}
    merged = {name: area for name, area in {**read(path), **areas}.items() if name in names}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text(merged).encode())


def keep_here(areas: Mapping[str, Area], there: Iterable[str]) -> None:
    """Write areas into the results of this machine, if anything can be written there."""
    if areas and cache_dir("tests") is not None:
        keep(areas, there, own_path())


def text(areas: Mapping[str, Area]) -> str:
    """Return a record as JSON: sorted, with a line for each run, area and feature."""
    runs = {area.run.when: area.run for area in areas.values()}
    lines = [f'{{"format": {FORMAT}, "runs": {{']
    lines += _lines(f"{_json(when)}: {_json(_run(run))}" for when, run in sorted(runs.items()))
    lines += ['}, "areas": {']
    for place, (name, area) in enumerate(sorted(areas.items())):
        head = f'{_json(name)}: {{"run": {_json(area.run.when)}, "tests": {_json(_tidy(area.tests))}, "features": {{'
        lines.append(head)
        lines += _lines(f"{_json(slug)}: {_json(_tidy(one))}" for slug, one in sorted(area.features.items()))
        lines.append("}}" + "," * (place < len(areas) - 1))
    return "\n".join([*lines, "}}"]) + "\n"


def total(counts: Iterable[Counts]) -> dict[str, int]:
    """Return the sum of counts."""
    found: Counter[str] = Counter()
    for one in counts:
        found.update(one)
    return dict(found)


def state(counts: Counts | None) -> str:
    """Return the one word for counts: a failure counts for all, and "skipped" is what has only skips."""
    return next((word for word in ("failed", "passed", "skipped") if counts and counts.get(word)), "not run")


def said(counts: Counts | None) -> str:
    """Return "412 passed, 3 skipped"; "not run" where nothing is known."""
    found = counts or {}
    return ", ".join(f"{found[k]} {k}" for k in ("passed", "failed", "skipped") if found.get(k)) or "not run"


def _run(run: Run) -> dict[str, Any]:
    long = {"long": True} if run.long else {}
    return {"commit": run.commit, "devices": dict(sorted(run.devices.items())), **long}


def _tidy(by_backend: Mapping[str, Counts]) -> dict[str, dict[str, int]]:
    order = [*BACKENDS]
    return {b: dict(sorted(by_backend[b].items())) for b in sorted(by_backend, key=order.index)}


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _lines(entries: Iterable[str]) -> list[str]:
    """Return the entries of an object, each on a line, with a comma after all but the last."""
    found = [f" {entry}," for entry in entries]
    return [*found[:-1], found[-1][:-1]] if found else []
