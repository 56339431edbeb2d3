"""What a test run leaves and says: counts per area, variant and feature; skips that CI does not allow; time budgets.

tests/allowed_skips.txt   "test id pattern | part of the reason": what may be skipped in CI (`CI=true`)
tests/oracles.toml        which tests must have passed, and on which backends (tests/support/oracles.py)
docs/records/long.json    of every long test the last result, with commit, device and time
docs/records/tests.json   with --record, results of whole areas for the site (tests/support/records.py); without it they
                          stay in the user's cache, for `strata list --features`
"""

from __future__ import annotations

import datetime
import fnmatch
import json
import os
import re
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from typing import Any

import pytest

import chapters
from common.paths import ROOT, user_cache, write_whole
from tests.support import oracles, records, sharing
from tools.bench.bench import commit
from tools.ledger import features, results

ALLOWED_SKIPS = ROOT / "tests" / "allowed_skips.txt"
LONG_RECORD = ROOT / "docs" / "records" / "long.json"
TEST_BUDGET_S = 5.0
AREA_BUDGET_S = 25.0
"""For one test, and in one variant for a chapter's own tests. Those of lessons before it, which the newest chapter runs
in all variants, may take as much again. Tests marked `long` have none.

A test has a core of its own, beside which drivers' threads have what the other process leaves (sharing.py): they draw
up to twice as slowly then, which is no work of the chapter's. So to a chapter counts the time that passed in a test or
the time that its threads and children worked, whichever is less.
"""

CORE_BUDGET_S = 6.0
"""Of that, for the core tests of lessons before it that a chapter runs by turns, in one variant: measured, those of a
lesson take 0.8 s in a later chapter, over three variants, so those of 13 lessons take 3.5 s in each."""

COLD_FACTOR = 3.5
"""How much more a run may take that finds no compiled shader: the driver then compiles at each pipeline's first draw,
which is no test's own time, and it happens once per machine (chapter 1 on Vulkan in software: 24 s warm, 43 s cold;
chapter 12, whose kernels traverse and look up textures: 77 s warm, 190 s cold on a slower machine)."""

SHARED_FACTOR = 2.0
"""How much more a run may take that two processes share. On two cores each has at least one, which is half of what it
has alone, so its tests take at most twice as long (chapter 5 on OpenGL: 26 s alone, 38 to 59 s of work shared)."""

WARM_SHADERS = 500
"""A whole run leaves 1,470 compiled shaders, and trying the drivers a hundred: with fewer than this a run is cold."""

COLD_TEST_BUDGET_S = 20.0
"""For one test then: the first to draw a scene of many materials compiles for all that follow."""


LATER = re.compile(r"(?<=\.py)::(ch\d\d)(?:-fork)?::")
"""What an id says of a test that runs for another chapter than its own, or for a fork (tests/support/snapshots.py)."""


@dataclass
class Outcome:
    """What became of one test, over its set-up, call and tear-down."""

    nodeid: str
    features: tuple[str, ...]
    long: bool
    result: str = "not run"  # until it was: a run may be stopped before
    reason: str = ""
    seconds: float = 0.0
    busy: float = 0.0
    """The part of the seconds that counts for its chapter."""
    backends: tuple[str, ...] = ("cpu",)
    turn: bool = False
    """Whether it is a core test that takes turns (tests/support/snapshots.py)."""
    area: str = field(init=False)
    variant: str = field(init=False)
    own: bool = field(init=False)
    """Whether it is a test of the lesson that its area names, and not of one before."""

    def __post_init__(self) -> None:
        later, home = LATER.search(self.nodeid), features.area_of(self.nodeid.partition("::")[0])
        self.area = later[1] if later else home
        self.own = self.area == home
        found = re.search(r"\[(vulkan|without-all|gl|deferred)\b", self.nodeid)
        self.variant = found[1] if found else "-"

    @property
    def test(self) -> str:
        """The function's name, for whatever parameters and chapter: "tests/ch01/test_a.py::test_b"."""
        file, *names = LATER.sub("::", self.nodeid).partition("[")[0].split("::")
        return f"{file}::{names[-1]}" if names else file


def allowed_skips(text: str) -> list[tuple[str, str]]:
    """Return (pattern of test ids, part of the reason) of each line that is no comment."""
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition("|") for line in lines if line and not line.startswith("#"))
    return [(pattern.strip(), reason.strip()) for pattern, _, reason in pairs]


def is_allowed(outcome: Outcome, allowed: list[tuple[str, str]]) -> bool:
    """Whether a skip is in the written list; what stands there of a test holds for it in later chapters too."""
    names = {outcome.nodeid, LATER.sub("::", outcome.nodeid)}
    return any(r and r in outcome.reason and fnmatch.filter(names, p) for p, r in allowed)


def over_budget(outcomes: list[Outcome], cold: bool = False, shared: bool = False) -> list[str]:
    """Return a sentence for each test and each chapter's variant that took longer than it may."""
    a_test, a_chapter, a_core = TEST_BUDGET_S, AREA_BUDGET_S, CORE_BUDGET_S
    if cold:
        a_test, a_chapter, a_core = COLD_TEST_BUDGET_S, COLD_FACTOR * a_chapter, COLD_FACTOR * a_core
    if shared:
        a_test, a_chapter, a_core = (SHARED_FACTOR * budget for budget in (a_test, a_chapter, a_core))
    quick = [outcome for outcome in outcomes if not outcome.long]
    texts = [
        f"{o.nodeid} took {o.seconds:.1f} s; a test may take {a_test:g} s"
        for o in quick
        if o.seconds > a_test
    ]
    for own, whose in ((True, "its own tests"), (False, "tests of chapters before it")):
        for (area, variant), seconds in _totals(it for it in quick if it.own == own and not it.turn).items():
            if re.fullmatch(r"ch\d\d", area) and seconds > a_chapter:
                texts.append(
                    f"{area} ({variant}) took {seconds:.1f} s for {whose}; they may take {a_chapter:g} s a variant"
                )
    for (area, variant), seconds in _totals(outcome for outcome in quick if outcome.turn).items():
        if seconds > a_core:
            texts.append(
                f"{area} ({variant}) took {seconds:.1f} s for core tests of chapters before it; "
                f"they may take {a_core:g} s a variant"
            )
    return texts


def _totals(outcomes: Iterable[Outcome]) -> dict[tuple[str, str], float]:
    """Return the seconds that count of each area and variant."""
    totals: dict[tuple[str, str], float] = defaultdict(float)
    for outcome in outcomes:
        totals[outcome.area, outcome.variant] += outcome.busy
    return dict(sorted(totals.items()))


def worked() -> float:
    """Return the seconds that the threads of this process and its children that ended have worked."""
    return sum(os.times()[:4])


def summary(outcomes: list[Outcome]) -> list[str]:
    """Return the table of counts per area and variant, and the number of features that passed."""
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    seconds: dict[tuple[str, str], float] = defaultdict(float)
    for outcome in outcomes:
        key = outcome.area, outcome.variant
        counts[key][outcome.result] += 1
        seconds[key] += outcome.seconds
    busy = _totals(outcomes)
    lines = [
        f"{'area':<14}{'variant':<14}{'passed':>8}{'failed':>8}{'skipped':>9}{'seconds':>9}{'worked':>9}"
    ]
    for key in sorted(counts):
        c = counts[key]
        lines.append(
            f"{key[0]:<14}{key[1]:<14}{c['passed']:>8}{c['failed']:>8}{c['skipped']:>9}"
            f"{seconds[key]:>9.1f}{busy[key]:>9.1f}"
        )
    left = sum(outcome.result == "not run" for outcome in outcomes)
    if left:
        lines.append(f"{left} tests were not run: the run ended before them.")
    by_feature = feature_counts(outcomes)
    held = sum(1 for c in by_feature.values() if c.get("passed") and not c.get("failed"))
    lines.append(f"{len(by_feature)} features of the ledger have tests here, {held} of them pass.")
    return lines


def feature_counts(outcomes: list[Outcome]) -> dict[str, dict[str, int]]:
    """Return, for each feature that a test names, how many of its tests had which result."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for outcome in outcomes:
        if outcome.result == "not run":
            continue
        for slug in outcome.features:
            found[slug][outcome.result] += 1
    return {slug: dict(counts) for slug, counts in found.items()}


def why_skipped(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Return the reason that a skipped test or file gave."""
    return report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)


class Report:
    """The pytest plugin that collects all this and has the last word before pytest's own last line."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.outcomes: dict[str, Outcome] = {}
        self.devices: dict[str, str] = {}  # by backend
        self.files: set[str] = set()  # that were collected
        self.skipped_files: dict[str, str] = {}  # at their import
        self.said: list[str] = []
        self._worked = 0.0
        self.shared = False  # whether a second process ran beside this one
        self.in_ci = os.environ.get("CI") == "true"
        self.complaints: list[str] = []  # that fail a run in CI
        self.faults: list[str] = []  # that fail any run
        compiled = user_cache() / "spirv"
        self.cold = not compiled.is_dir() or len(list(compiled.iterdir())) < WARM_SHADERS

    @property
    def device(self) -> str:
        """What the run drew with, in a few words."""
        return "; ".join(dict.fromkeys(self.devices.values())) or "no device was opened"

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        file = report.nodeid.partition("::")[0]
        if file.endswith(".py"):
            self.files.add(file)
        if report.skipped:
            self.skipped_files[file] = why_skipped(report)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        later: Any = self.config.pluginmanager.getplugin("strata-snapshots")
        for item in session.items:
            slugs = tuple(slug for mark in item.iter_markers("feature") for slug in mark.args)
            long = item.get_closest_marker("long") is not None
            self.outcomes[item.nodeid] = Outcome(
                item.nodeid,
                slugs,
                long,
                backends=records.backends_of(item),
                turn=later is not None and later.takes_turns(item),
            )

    def pytest_runtest_logstart(self) -> None:
        self._worked = worked()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, Any, Any]:
        """Note in the report what counts: the first of two processes gets it with the report of the second."""
        report = yield
        before, self._worked = self._worked, worked()
        report.busy = min(report.duration, self._worked - before)
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        outcome = self.outcomes.get(report.nodeid)
        if outcome is None:
            return
        # A device or a renderer that a whole module shares is made in the set-up of its first test: the area's time.
        outcome.seconds += report.duration
        outcome.busy += getattr(report, "busy", report.duration)
        if report.failed:
            outcome.result = "failed"
        elif report.when == "call" and report.passed:
            outcome.result = "passed"
        elif report.skipped and outcome.result != "failed":
            outcome.result = "skipped"
            outcome.reason = why_skipped(report)

    def _has_nothing_to_say(self) -> bool:
        """Whether nothing was run, or the first of two processes says it."""
        nothing = self.config.option.collectonly or not (self.outcomes or self.skipped_files)
        return nothing or sharing.is_second(self.config)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        if self._has_nothing_to_say():
            return
        outcomes = list(self.outcomes.values())
        later: Any = self.config.pluginmanager.getplugin("strata-snapshots")
        of_fork = later is not None and any(subject.is_fork for subject in later.chosen)
        self.complaints = over_budget(outcomes, self.cold, self.shared)
        if not of_fork:  # a fork that fails says nothing of the project's features
            self._hold_to_the_table(outcomes)
        if self.in_ci:
            text = ALLOWED_SKIPS.read_text("utf-8") if ALLOWED_SKIPS.is_file() else ""
            allowed = allowed_skips(text)
            self.complaints += [
                f"{o.nodeid} was skipped ({o.reason}), which {ALLOWED_SKIPS.name} does not allow"
                for o in outcomes
                if o.result == "skipped" and not is_allowed(o, allowed)
            ]
            self.complaints += [
                f"{name} was skipped as a whole ({reason}), which {ALLOWED_SKIPS.name} does not allow"
                for name, reason in self.skipped_files.items()
                if not is_allowed(Outcome(f"{name}::", (), False, "skipped", reason), allowed)
            ]
        if (self.faults or (self.in_ci and self.complaints)) and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        if not of_fork and outcomes:
            self._keep(outcomes)

    def _hold_to_the_table(self, outcomes: list[Outcome]) -> None:
        """Complain of what the run does not bear out of the table of truths."""
        path = self.config.rootpath / "tests" / oracles.TABLE.name
        if not path.is_file():
            return
        left = [
            Outcome(f"{file}::{name}", slugs, False, "skipped", reason, backends=oracles.BACKENDS)
            for file, reason in self.skipped_files.items()
            if file.endswith(".py")
            for name, slugs in features.marked(self.config.rootpath / file).items()
        ]
        for one in oracles.unproven(oracles.read(path), [*outcomes, *left], self.is_whole()):
            (self.complaints if one.skipped else self.faults).append(one.sentence)

    def is_whole(self) -> bool:
        """Whether all tests were run, but those that take minutes and those that were skipped."""
        wanted = {features.area_of(file) for file in records.files_there(self.config.rootpath)}
        found = {area for area, why in self.whole_areas().items() if not why}
        return wanted <= found and all(one.result != "not run" for one in self.outcomes.values())

    def _keep(self, outcomes: list[Outcome]) -> None:
        """Write the results of whole areas, for `strata list --features` and the site, and those of long tests."""
        head = {
            "when": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "commit": commit(),
            "device": self.device,
        }
        self._keep_areas(outcomes, head["when"], head["commit"])
        if self.config.getoption("--long") and any(o.long for o in outcomes):
            LONG_RECORD.parent.mkdir(parents=True, exist_ok=True)
            write_whole(LONG_RECORD, (json.dumps(long_record(outcomes, head), indent=1) + "\n").encode())

    def whole_areas(self) -> dict[str, str]:
        """Return the areas of this run: "" for one that it has as a whole, else why not."""
        later: Any = self.config.pluginmanager.getplugin("strata-snapshots")
        subjects = {chapters.folder_name(one.number) for one in later.chosen} if later else set()
        there = records.files_there(self.config.rootpath)
        found = records.whole_areas(self.files & {*there}, subjects, there)
        partial = records.why_partial(self.config)
        return {area: why or partial for area, why in found.items()}

    def _keep_areas(self, outcomes: list[Outcome], when: str, at: str) -> None:
        found, there = self.whole_areas(), features.areas_there(self.config.rootpath / "tests")
        devices = {**self.devices, "cpu": records.cpu()}
        run = results.Run(when, at, devices, self.config.getoption("--long"))
        whole = [area for area, why in found.items() if not why]
        skipped = {name: why for name, why in self.skipped_files.items() if name.endswith(".py")}
        areas = records.areas_of(outcomes, skipped, whole, run, self.config.rootpath)
        results.keep_here(areas, there)
        if not self.config.getoption("--record", default=False):
            return
        path = results.RECORD.relative_to(ROOT)
        results.keep(areas, there, self.config.rootpath / path)
        self.said.append(f"{path.as_posix()} has the results of {', '.join(areas) or 'no area'}.")
        left = {area: found[area] or "the run ended before all its tests were run" for area in found}
        self.said += [f"It keeps what it had of {area}: {left[area]}." for area in left if area not in areas]

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self._has_nothing_to_say():
            return
        terminalreporter.section("strata", sep="=")
        cache = "shaders were compiled in this run" if self.cold else "compiled shaders were there"
        quick = ", quickly" if os.environ.get("GALLIVM_PERF") == "nopt" else ""
        terminalreporter.line(f"device: {self.device}; {cache}{quick}")
        later: Any = self.config.pluginmanager.getplugin("strata-snapshots")
        for line in summary(list(self.outcomes.values())) + (later.summary() if later else []):
            terminalreporter.line(line)
        for line in self.said:
            terminalreporter.line(line)
        for name, reason in () if self.in_ci else self.skipped_files.items():
            terminalreporter.line(f"note: {name} was skipped as a whole ({reason})")
        for text in self.faults:
            terminalreporter.line("FAILED " + text, red=True)
        for text in self.complaints:
            terminalreporter.line(("FAILED " if self.in_ci else "note: ") + text, red=self.in_ci)


def long_record(outcomes: list[Outcome], head: dict[str, Any]) -> dict[str, Any]:
    """Return the record of the long tests: of each the last result, with when and where that was."""
    try:
        kept: dict[str, Any] = json.loads(LONG_RECORD.read_text("utf-8"))["tests"]
    except (OSError, ValueError, KeyError):
        kept = {}
    fresh = {
        o.nodeid: {"result": o.result, "seconds": round(o.seconds, 1), **head}
        for o in outcomes
        if o.long and o.result != "not run"
    }
    there = {name: kept[name] for name in kept if (ROOT / name.partition("::")[0]).is_file()}
    return {"tests": dict(sorted({**there, **fresh}.items()))}
