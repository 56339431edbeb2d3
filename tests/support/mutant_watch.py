"""A pytest plugin for runs over mutants: writes to a file what becomes of each test, and which lines it runs.

It is copied out of the clone and loaded by its file's name alone, since it also watches projects other than this one.

    MUTANTS_LOG     the file: JSON, one object a line, written when a test begins and when it ends
    MUTANTS_COVER   the root of the clone whose lines are measured; nothing is measured without it
    MUTANTS_PARTS   with that: the folders that are measured, separated by spaces

Processes that a test starts are measured too, if their interpreter reads coverage's .pth file and they end by
themselves.
A file that a module's fixture reads, or a line that it runs, belongs to the first test of the module.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

SHADERS = {".glsl", ".vert", ".tesc", ".tese", ".geom", ".task", ".mesh", ".frag", ".comp"}


def ranges(lines: Iterable[int]) -> str:
    """Return line numbers in short: "3-7,9"."""
    found: list[list[int]] = []
    for line in sorted(lines):
        if found and line == found[-1][1] + 1:
            found[-1][1] = line
        else:
            found.append([line, line])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in found)


class Lines:
    """The lines of a clone that run, in this process and in those that it starts."""

    def __init__(self, root: Path, parts: list[str]) -> None:
        import coverage

        self.root = root
        self._read: set[str] = set()
        self._folder = Path(tempfile.mkdtemp(prefix="strata-lines-"))
        include = [f"{root / part}/*" for part in parts]
        rules = self._folder / "rules.ini"
        options = {
            "parallel": "true",
            "data_file": f"{self._folder}/lines",
            "core": "ctrace",
            "disable_warnings": "no-data-collected",  # measuring is not to be seen in what a process prints
            "include": "".join(f"\n    {one}" for one in include),
        }
        rules.write_text(
            "[run]\n" + "".join(f"{name} = {value}\n" for name, value in options.items()), "utf-8"
        )
        self._coverage = coverage.Coverage(data_file=None, config_file=False, include=include)
        self._coverage.set_option("run:core", "ctrace")  # others know no contexts
        self._coverage.start()
        os.environ["COVERAGE_PROCESS_START"] = str(rules)
        sys.addaudithook(self._hear)

    def begin(self, name: str) -> None:
        """Begin with a test."""
        self._read.clear()
        kept = sys.modules.get("common.files.shader_files")
        if kept is not None:
            kept.__dict__.get("_analysed", {}).clear()  # a text that is kept would be read by one test alone
        self._coverage.switch_context(name)

    def end(self, name: str) -> dict[str, str]:
        """Return the lines of each file that the test ran; of shaders all that it read."""
        data = self._coverage.get_data()
        data.set_query_context(name)
        found = {file: set(data.lines(file) or ()) for file in data.measured_files()}
        self._coverage.switch_context("")
        self._add_children(found)
        below = {os.path.relpath(file, self.root): ranges(lines) for file, lines in found.items() if lines}
        return below | dict.fromkeys(self._read, "*")

    def stop(self) -> None:
        """Measure no more."""
        self._coverage.stop()

    def _add_children(self, found: dict[str, set[int]]) -> None:
        import coverage

        for path in self._folder.glob("lines.*"):
            data = coverage.CoverageData(str(path))
            try:
                data.read()
                for file in data.measured_files():
                    found.setdefault(file, set()).update(data.lines(file) or ())
            except coverage.CoverageException:
                pass  # the process was ended while it wrote
            finally:
                data.close()
                path.unlink(missing_ok=True)

    def _hear(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(args[0], str | os.PathLike):
            path = os.fspath(args[0])
            if isinstance(path, str) and os.path.splitext(path)[1] in SHADERS:
                below = os.path.relpath(os.path.realpath(path), self.root)
                if not below.startswith(".."):
                    self._read.add(below)


class Watch:
    """The plugin."""

    def __init__(self, log: Path, lines: Lines | None) -> None:
        self._log = log
        self._lines = lines
        self._now: dict[str, Any] = {}

    def _write(self, **entry: Any) -> None:
        with self._log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry) + "\n")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Say which file cannot be imported."""
        if report.failed:
            self._write(broken=report.nodeid)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Watch a test with its fixtures."""
        self._now = {"id": item.nodeid, "outcome": "passed", "setup": 0.0, "seconds": 0.0}
        self._write(begin=item.nodeid)
        if self._lines:
            self._lines.begin(item.nodeid)
        try:
            return (yield)
        finally:
            more = {"lines": self._lines.end(item.nodeid)} if self._lines else {}
            self._write(**self._now, **more)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the time and the worst result of a test's parts."""
        self._now["setup" if report.when == "setup" else "seconds"] += report.duration
        if report.failed or (report.skipped and self._now["outcome"] == "passed"):
            self._now["outcome"] = "failed" if report.failed else "skipped"

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Say what was drawn with."""
        report: Any = session.config.pluginmanager.getplugin("strata-report")
        self._write(devices=dict(getattr(report, "devices", {})))
        if self._lines:
            self._lines.stop()


def pytest_configure(config: pytest.Config) -> None:
    """Begin, where there is a file to write to: processes of tests run pytest too."""
    if _watch is not None:
        config.pluginmanager.register(_watch, "mutants-watch")


def _begin() -> Watch | None:
    log = os.environ.pop("MUTANTS_LOG", "")
    root = os.environ.pop("MUTANTS_COVER", "")
    parts = os.environ.pop("MUTANTS_PARTS", "").split()
    return Watch(Path(log), Lines(Path(root), parts) if root else None) if log else None


_watch = _begin()
"""Made before the clone's own modules are imported."""
