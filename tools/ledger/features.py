"""Which tests hold which feature of the ledger, and what became of them: read from the tests' own marks and records.

A test says `@pytest.mark.feature("async-compute/queue")`. These marks are the list of features. The ledger itself, a
table with their titles, is not part of the project; where somebody has it (`STRATA_FEATURES`, else
`../shared/features.tsv`), titles are shown and rows without a test are named.
"""

from __future__ import annotations

import ast
import csv
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import chapters
from chapters import studies
from common.paths import ROOT
from tools.ledger import results
from tools.ledger.results import Area, Counts

TESTS = ROOT / "tests"
FEW = 4
"""So many areas are named in a command; for more it is the one for all."""
_MARK = "mark.feature"


@dataclass(frozen=True)
class MarkedTest:
    """A test function that bears the mark, as "tests/ch05/test_timeline.py::test_x"."""

    name: str
    area: str


@dataclass(frozen=True)
class Row:
    """What the ledger says of a feature: its title, where it belongs ("ch05", "common"), and on which backends."""

    title: str
    home: str
    backends: tuple[str, ...]


@dataclass(frozen=True)
class Feature:
    """A feature, its tests, and the chapters that they, or a study of it, are about; `row` where the ledger is."""

    slug: str
    tests: tuple[MarkedTest, ...]
    chapters: tuple[int, ...]
    row: Row | None = None

    @property
    def areas(self) -> tuple[str, ...]:
        """The areas in which there are tests of it."""
        return tuple(sorted({test.area for test in self.tests}))

    def matches(self, text: str) -> bool:
        """Whether its name, its title or a test's name has all the words of `text`, in any letters."""
        known = " ".join([self.slug, self.row.title if self.row else "", *(one.name for one in self.tests)])
        plain = re.sub(r"[-_ ]+", " ", known.lower())
        return all(word in plain for word in re.sub(r"[-_ ]+", " ", text.lower()).split())


# --- what the tests say -----------------------------------------------------------------------------------------------


def area_of(path: str) -> str:
    """Return the area of a file of tests: "cli" for tests/cli/test_run.py, "panel" for tests/test_panel.py.

    The stability of a chapter, tests/stability/test_ch01.py, belongs to that chapter.
    """
    parts = Path(path).parts
    of_chapter = parts[1] == "stability" and re.fullmatch(r"test_ch\d\d\.py", parts[2])
    name = parts[2] if of_chapter else parts[1]
    return name.removeprefix("test_").removesuffix(".py")


def marked(path: Path) -> dict[str, tuple[str, ...]]:
    """Return the tests of a file that bear the mark, by name, with their features; {} for a file with a mistake."""
    text = path.read_text("utf-8")
    if _MARK not in text:
        return {}
    try:
        tree = ast.parse(text)
    except SyntaxError:  # somebody is writing it; pytest says so
        return {}
    names: dict[str, list[str]] = {"pytestmark": []}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            names[node.targets[0].id] = _slugs(node.value, names)
    found: dict[str, tuple[str, ...]] = {}
    classes = (node for node in tree.body if isinstance(node, ast.ClassDef))
    for function in (*tree.body, *(node for one in classes for node in one.body)):
        if isinstance(function, ast.FunctionDef) and function.name.startswith("test_"):
            own = [slug for decorator in function.decorator_list for slug in _slugs(decorator, names)]
            if held := [*own, *names["pytestmark"]]:
                found[function.name] = tuple(dict.fromkeys(held))
    return found


def _slugs(node: ast.AST, names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the features in an expression of marks; `names` are marks that the file has named before."""
    found: list[str] = []
    for one in ast.walk(node):
        if isinstance(one, ast.Name):
            found += names.get(one.id, ())
        elif isinstance(one, ast.Call) and "feature" in (getattr(one.func, a, "") for a in ("attr", "id")):
            found += [str(word.value) for word in one.args if isinstance(word, ast.Constant)]
    return found


@cache
def marked_tests(folder: Path = TESTS) -> dict[str, tuple[MarkedTest, ...]]:
    """Return the tests of each feature that any of them names."""
    found: dict[str, list[MarkedTest]] = defaultdict(list)
    for path in sorted(folder.rglob("test_*.py")):
        name = f"tests/{path.relative_to(folder).as_posix()}"
        for function, slugs in marked(path).items():
            for slug in slugs:
                found[slug].append(MarkedTest(f"{name}::{function}", area_of(name)))
    return {slug: tuple(tests) for slug, tests in sorted(found.items())}


def areas_there(folder: Path = TESTS) -> set[str]:
    """Return the areas of tests/ that hold tests, and the chapters that are tested by those of earlier ones."""
    found = {area_of(f"tests/{path.relative_to(folder).as_posix()}") for path in folder.rglob("test_*.py")}
    return found | {chapters.folder_name(number) for number in chapters.available()}


# --- what the ledger says ---------------------------------------------------------------------------------------------


def ledger(path: Path | None = None) -> dict[str, Row]:
    """Return the rows of the ledger by slug; {} where it is not here."""
    chosen = os.environ.get("STRATA_FEATURES")
    where = path or (Path(chosen) if chosen else ROOT.parent / "shared" / "features.tsv")
    try:
        with where.open(encoding="utf-8", newline="") as file:
            rows = [*csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE)]
        return {row["slug"]: Row(row["title"], row["home"], _backends(row["backends"])) for row in rows}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _backends(text: str) -> tuple[str, ...]:
    named = {"vk": "vulkan", "gl": "gl", "cpu": "cpu"}
    return tuple(named[word] for word in text.split("+") if word in named)


def here(row: Row) -> bool:
    """Whether a row of the ledger belongs to what is here, and not to a chapter that is still to come."""
    chapter = re.fullmatch(r"ch(\d\d)", row.home)
    return chapter is None or int(chapter[1]) in chapters.available()


def features(rows: Mapping[str, Row] | None = None) -> list[Feature]:
    """Return all features that a test names, and those rows of the ledger that no test names, by slug."""
    known, tests, studied = rows or {}, marked_tests(), _studied()
    found = []
    for slug in sorted({*tests, *(slug for slug, row in known.items() if here(row))}):
        row = known.get(slug)
        names = {test.area for test in tests.get(slug, ())} | ({row.home} if row and here(row) else set())
        numbers = {int(name[2:]) for name in names if re.fullmatch(r"ch\d\d", name)} | studied.get(
            slug, set()
        )
        found.append(Feature(slug, tests.get(slug, ()), tuple(sorted(numbers)), row))
    return found


def _studied() -> dict[str, set[int]]:
    """Return the chapters that have a study of a feature; one that cannot be imported costs its own alone."""
    found: dict[str, set[int]] = defaultdict(set)
    for number in chapters.available():
        with suppress(Exception):
            for study in studies.available(number).values():
                for slug in study.features:
                    found[slug].add(number)
    return found


OTHER = "Shared code and tools"


def grouped(found: Iterable[Feature]) -> dict[str, list[Feature]]:
    """Return features by the first chapter that holds them; what no chapter holds comes last."""
    groups: dict[str, list[Feature]] = defaultdict(list)
    for one in found:
        groups[f"Chapter {one.chapters[0]}" if one.chapters else OTHER].append(one)
    order = [f"Chapter {number}" for number in chapters.available()]
    return {title: groups[title] for title in (*order, OTHER) if title in groups}


# --- what became of them ----------------------------------------------------------------------------------------------


def states(feature: Feature, record: Mapping[str, Area]) -> dict[str, Counts]:
    """Return by backend what became of a feature's tests, in all areas of the record together."""
    held = [area.features[feature.slug] for area in record.values() if feature.slug in area.features]
    return {
        backend: results.total(one[backend] for one in held if backend in one)
        for backend in results.BACKENDS
        if any(backend in one for one in held)
    }


def state(feature: Feature, backend: str, record: Mapping[str, Area]) -> str:
    """Return "passed", "failed", "skipped", "not run", "no test" where the ledger wants one, or "" for no test.

    It is "not run" as long as there is no result of some area with tests of it: nobody knows what those run on.
    """
    counts = states(feature, record)
    if backend in counts:
        return results.state(counts[backend])
    if {*feature.areas} - {*record} or (feature.tests and not counts):
        return "not run"
    return "no test" if feature.row and backend in feature.row.backends else ""


@dataclass(frozen=True)
class OutOfDate:
    """In what a record falls short of the tests that are there; empty where it does not."""

    areas: tuple[str, ...] = ()
    """Areas with tests of features, and chapters, of which it has no result."""
    unheard: tuple[str, ...] = ()
    """Features that tests of recorded areas name and of which it has no result."""
    gone: tuple[str, ...] = ()
    """Features of which it has a result and that no test names any more."""
    again: tuple[str, ...] = ()
    """Areas that have to be run anew to mend all that."""

    def sentences(self) -> list[str]:
        """Return what is wrong, and the command that mends it."""
        said = [
            f"{what} {', '.join(names)}"
            for what, names in (
                ("no results of", self.areas),
                ("no result for", self.unheard),
                ("results for what no test names any more:", self.gone),
            )
            if names
        ]
        return [f"{'; '.join(said)}: `{run_command(self.again, record=True)}` keeps them."] if said else []


def run_command(areas: Iterable[str], record: bool = False) -> str:
    """Return the command that tests some areas, or all where they are many; `record`: and keeps that for the site."""
    names = [*areas]
    return " ".join(["./strata test", *(names if len(names) <= FEW else ()), *["--record"] * record])


def out_of_date(record: Mapping[str, Area], soon: Iterable[str] = ()) -> OutOfDate:
    """Return in what a record falls short; areas that are recorded `soon` count as done.

    A record is not out of date because a commit came after it: it says itself at which commit it was made. It is where
    its tables have gaps, or tell of what is no longer there. More or fewer tests of a feature make no gap.
    """
    done, tests = {*soon}, marked_tests()
    wanted = {test.area for held in tests.values() for test in held}
    wanted |= {chapters.folder_name(number) for number in chapters.available()}
    areas = sorted(wanted - {*record} - done)
    heard = {slug for area in record.values() for slug in area.features}
    unheard = [
        slug
        for slug, held in tests.items()
        if slug not in heard and not {test.area for test in held} & {*done, *areas}
    ]
    gone = {slug: name for name, area in record.items() for slug in area.features if slug not in tests}
    gone = {slug: name for slug, name in sorted(gone.items()) if name not in done}
    again = {*areas, *gone.values(), *(test.area for slug in unheard for test in tests[slug])}
    return OutOfDate(tuple(areas), tuple(unheard), tuple(gone), tuple(sorted(again)))
