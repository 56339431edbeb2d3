"""Two processes share the tests of a long run: the first has what chapters and their studies draw, the second the rest.

Each of both parts takes about half of the time of a whole run.

The second process is pytest with the arguments of the first. It sends each report through a pipe, and the first takes
it as one of its own: progress, counts, `-x`, `--durations`, JUnit's file, the budgets and the records see every test.

Tests marked `alone` measure time. The first process runs them at the end, when the second one has ended.

There is one process where the smaller part has fewer than `FEWEST` tests, on a machine with one core, with
`--processes=1`, and where pytest talks to the user (`--pdb`, `-s`).
"""

from __future__ import annotations

import _thread
import contextlib
import os
import pickle
import queue
import re
import signal
import subprocess
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Generator, Iterator
from typing import Any, BinaryIO

import pytest

from tests.support import records

FEWEST = 300
"""Tests of the smaller part. A process takes half a minute and more until it has collected its tests."""

OF_A_CHAPTER = re.compile(r"tests/(ch\d\d|studies)/")
"""What the ids of tests of chapters and their studies begin with."""

PATIENCE_S = 20.0
"""How long the second process may take to end when it is told to."""

ASK_THE_USER = ("usepdb", "trace", "collectonly", "setuponly", "setupplan", "setupshow")
"""Options of pytest with which one process runs all tests."""


def is_second(config: pytest.Config) -> bool:
    """Whether this is the second process; pytest's own plugins ask for the same attribute before they write files."""
    return hasattr(config, "workerinput")


def is_for_second(item: pytest.Item) -> bool:
    """Whether the second process runs a test."""
    draws = records.backends_of(item) != ("cpu",)
    return not (item.get_closest_marker("alone") or (draws and OF_A_CHAPTER.match(item.nodeid)))


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def add_options(parser: pytest.Parser) -> None:
    """Add `--processes`."""
    parser.addoption(
        "--processes", type=int, choices=(1, 2), default=2, help="how many processes may share a long run"
    )


class Sharing:
    """The plugin of the first process."""

    def __init__(self, config: pytest.Config, fewest: int = FEWEST) -> None:
        self.config, self.fewest = config, fewest
        self._process: subprocess.Popen[bytes] | None = None
        self._messages: queue.Queue[Any] = queue.Queue()
        self._missing: set[str] = set()
        self._running = ""
        self._collected: Counter[bool] = Counter()

    def may_share(self) -> bool:
        """Whether nothing but the number of tests speaks against two processes."""
        option = self.config.option
        asks = any(getattr(option, name, False) for name in ASK_THE_USER) or option.capture == "no"
        watched = self.config.pluginmanager.has_plugin("mutants-watch")  # it watches this process
        return not asks and not watched and option.processes > 1 and cores() > 1

    def parts(self, items: list[pytest.Item]) -> tuple[list[pytest.Item], list[pytest.Item]]:
        """Return the tests of the first process, those marked `alone` last, and those of the second."""
        theirs = [item for item in items if is_for_second(item)]
        few = min(len(theirs), len(items) - len(theirs)) < self.fewest
        if few or not self.may_share():
            return items, []
        mine = [item for item in items if not is_for_second(item)]
        return sorted(mine, key=lambda item: item.get_closest_marker("alone") is not None), theirs

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Start the second process as soon as both parts are large enough: it collects beside this one."""
        if self._process is None and self.may_share():
            self._collected[is_for_second(item)] += 1
            if min(self._collected[True], self._collected[False]) >= self.fewest:
                self._start()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Refuse ids that are others in the second process."""
        for item in items:
            if re.search(r" at 0x[0-9a-f]+", item.nodeid):
                raise pytest.UsageError(
                    f"{item.nodeid}: each process has another address. Give the test `ids`."
                )

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Generator[None, Any, Any]:
        """Run the tests of the first process beside those of the second."""
        every = session.items
        session.items, theirs = self.parts(every)
        if not theirs or session.testsfailed:
            self._end()
            return (yield)
        if self._process is None:
            self._start()
        self._missing = {item.nodeid for item in theirs}
        self._report.shared = True
        try:
            done = yield
            self._wait(session)
            return done
        finally:
            self._end()
            session.items = every

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> Generator[None, Any, Any]:
        """Wait before tests that must run alone; after each file take the reports that have come."""
        if self._process is not None and item.get_closest_marker("alone"):
            self._wait(item.session)
        done = yield
        if nextitem is None or nextitem.path != item.path:
            while not self._messages.empty():
                if (message := self._messages.get()) is None:
                    self._messages.put(None)  # `_wait` takes the end
                    break
                self._take(message)
        return done

    def pytest_sessionfinish(self) -> None:
        """End a second process that was started for tests that could not be collected."""
        self._end()

    def _start(self) -> None:
        given = [*map(str, self.config.invocation_params.args)]
        if base := self.config.option.basetemp:
            given.append(f"--basetemp={base}-second")
        command = [sys.executable, "-P", "-m", "tests.support.sharing", *given]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=self.config.invocation_params.dir
        )
        reader = threading.Thread(
            target=self._read, args=(self._process.stdout,), name="reports", daemon=True
        )
        reader.start()

    def _read(self, pipe: BinaryIO) -> None:
        try:
            with contextlib.suppress(EOFError, pickle.UnpicklingError, ValueError):
                while True:
                    self._messages.put(pickle.load(pipe))
        finally:
            self._messages.put(None)

    def _wait(self, session: pytest.Session) -> None:
        """Take reports until the second process has sent its last one; raise what ends pytest's own loop."""
        while self._process is not None and (message := self._messages.get()) is not None:
            self._take(message)
            if session.shouldfail:
                raise session.Failed(session.shouldfail)
            if session.shouldstop:
                raise session.Interrupted(session.shouldstop)
        code = self._end()
        if self._missing:
            where = f" in {self._running}" if self._running else ""
            self._complain(
                f"The second process ended{where}, with exit code {code}: "
                f"{len(self._missing)} of its tests were not run."
            )
            self._missing.clear()

    def _take(self, message: Any) -> None:
        match message:
            case ("start", nodeid, location):
                self._running = nodeid
                self.config.hook.pytest_runtest_logstart(nodeid=nodeid, location=location)
            case ("report", data):
                report = self.config.hook.pytest_report_from_serializable(config=self.config, data=data)
                self.config.hook.pytest_runtest_logreport(report=report)
            case ("finish", nodeid, location):
                self._running = ""
                self._missing.discard(nodeid)
                self.config.hook.pytest_runtest_logfinish(nodeid=nodeid, location=location)
            case ("warning", warning, when, nodeid, location):
                self.config.hook.pytest_warning_recorded.call_historic(
                    kwargs={
                        "warning_message": warnings.WarningMessage(*warning),
                        "when": when,
                        "nodeid": nodeid,
                        "location": location,
                    }
                )
            case ("error", text):
                self._complain(f"The second process failed: {text}")
            case ("end", devices, uses):
                self._report.devices = devices | self._report.devices
                plugin: Any = self.config.pluginmanager.getplugin("strata-uses")
                for kind, files in uses.items():
                    plugin.files[kind] |= files

    @property
    def _report(self) -> Any:
        return self.config.pluginmanager.getplugin("strata-report")

    def _complain(self, text: str) -> None:
        self._report.faults.append(text)

    def _end(self) -> int:
        """End the second process and return its exit code; what its test has open is closed."""
        process, self._process = self._process, None
        if process is None:
            return 0
        assert process.stdin is not None
        process.stdin.close()
        try:
            return process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


class Second:
    """The plugin of the second process, which sends what it finds to `pipe`."""

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe = pipe
        self._config: Any = None

    def _send(self, *message: Any) -> None:
        self._pipe.write(pickle.dumps(message))
        self._pipe.flush()

    @pytest.hookimpl(tryfirst=True)
    def pytest_configure(self, config: Any) -> None:
        config.workerinput = {}
        self._config = config

    @pytest.hookimpl(wrapper=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> Iterator[None]:
        yield
        items[:] = [item for item in items if is_for_second(item)]

    def pytest_runtest_logstart(self, nodeid: str, location: Any) -> None:
        self._send("start", nodeid, location)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        self._send("report", data)

    def pytest_runtest_logfinish(self, nodeid: str, location: Any) -> None:
        self._send("finish", nodeid, location)

    def pytest_warning_recorded(
        self, warning_message: warnings.WarningMessage, when: str, nodeid: str, location: Any
    ) -> None:
        if when != "runtest":
            return  # the first process collects the same files
        one = warning_message
        self._send(
            "warning", (str(one.message), one.category, one.filename, one.lineno), when, nodeid, location
        )

    def pytest_internalerror(self, excrepr: Any) -> None:
        self._send("error", str(excrepr))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        plugins = self._config.pluginmanager
        uses = plugins.getplugin("strata-uses")
        self._send("end", plugins.getplugin("strata-report").devices, uses.files if uses else {})


def main(arguments: list[str]) -> int:
    """Run the second part of what pytest's arguments select; return pytest's exit code."""
    # pytest and the tests get other files in these places: they write nothing into the pipe and read none of it.
    kept_in, kept_out = os.dup(0), os.dup(1)
    with open(os.devnull, "r+b") as nothing:
        os.dup2(nothing.fileno(), 0)
        os.dup2(nothing.fileno(), 1)

    finished, main_thread = threading.Event(), threading.get_ident()

    def end_with_the_first() -> None:
        os.read(kept_in, 1)  # nothing is written: it returns where the first process closes it or is gone
        if finished.is_set():
            return
        if hasattr(signal, "pthread_kill"):  # it ends a wait, too
            signal.pthread_kill(main_thread, signal.SIGINT)
        else:
            _thread.interrupt_main()

    threading.Thread(target=end_with_the_first, daemon=True).start()
    try:
        with os.fdopen(kept_out, "wb") as pipe:
            code = int(pytest.main(arguments, plugins=[Second(pipe)]))
            finished.set()
            return code
    except (KeyboardInterrupt, BrokenPipeError):  # the first process needs nothing more
        return int(pytest.ExitCode.INTERRUPTED)


if __name__ == "__main__":
    # One module, not two: conftest.py imports it by name.
    from tests.support import sharing

    raise SystemExit(sharing.main(sys.argv[1:]))
