"""Two processes that share a run: which tests each runs, and that the first reports everything of both."""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as xml

import pytest

from common.paths import ROOT
from tests.support.timing import until

pytest_plugins = ["pytester"]

CONFTEST = """
from pathlib import Path
import pytest
from tests.support import packages, sharing
from tests.support.report import Report

packages.ROOT = Path(__file__).parent
sharing.cores = lambda: 2

def pytest_addoption(parser):
    parser.addoption("--long", action="store_true")
    parser.addoption("--uses", type=Path)
    sharing.add_options(parser)

def pytest_configure(config):
    for mark in ("feature(slug)", "long", "alone", "runs_on(backend)"):
        config.addinivalue_line("markers", mark)
    config.pluginmanager.register(Report(config), "strata-report")
    if not sharing.is_second(config):
        config.pluginmanager.register(sharing.Sharing(config, fewest=2), "strata-sharing")
    if config.getoption("--uses"):
        config.pluginmanager.register(packages.Uses(config.getoption("--uses")), "strata-uses")
"""
NOTING = """
import os, time
def note(name):
    with open("processes", "a") as file:
        file.write(f"{name} {os.getpid()} {time.monotonic()}\\n")

def wait(name):
    while name not in open("processes").read():
        time.sleep(0.01)
"""
DRAWN = """
import time, pytest
from noting import note, wait
pytestmark = pytest.mark.runs_on("vulkan")

def test_a(): note("a")

def test_b(): note("b")
"""
PLAIN = """
import importlib.util, os, time, warnings, pytest
from noting import note

@pytest.fixture
def held():
    note("open")
    yield
    note("closed")

def test_c(held): note("c")

@pytest.mark.alone
def test_alone(): note("alone")

def test_slow():
    time.sleep(1)
    note("slow")

@pytest.mark.skip(reason="no time")
def test_skipped(): pass

@pytest.mark.parametrize("number", [1, 2])
def test_fails(number):
    note("fails")
    warnings.warn("what it warns of")
    assert number == 1, "two is wrong"
"""
MEETING = """
import time
from noting import note
note("collected")
for _ in range(1000):
    if len({line.split()[1] for line in open("processes") if line.startswith("collected")}) == 2: break
    time.sleep(0.02)
else: raise TimeoutError("the other process is not there")

def test_then(): pass
"""
COMMAND = ("-m", "pytest", "-v", "-ra", "-p", "no:cacheprovider", "--import-mode=importlib")


class Tree:
    """Tests of a chapter that have a device, and tests that have none; each notes the process that ran it."""

    def __init__(self, pytester) -> None:
        self.path, self._pytester = pytester.path, pytester
        (self.path / "tests" / "ch01").mkdir(parents=True)
        (self.path / "noting.py").write_text(NOTING)
        pytester.makeconftest(CONFTEST)
        self.write()

    def write(self, **bodies: str) -> None:
        """Write both files; `bodies` are put before what the tests a, b and c note."""
        for name, text in {"drawn": DRAWN, "plain": PLAIN}.items():
            for test, body in bodies.items():
                text = text.replace(f'note("{test}")', f'{body}; note("{test}")')
            (self.path / "tests" / "ch01" / f"test_{name}.py").write_text(text)

    def run(self, *words: str) -> tuple[int, str]:
        """Return the exit code and all that was printed."""
        done = self._pytester.run(sys.executable, *COMMAND, *words, timeout=100)
        return done.ret, done.stdout.str() + done.stderr.str()

    @property
    def noted(self) -> dict[str, tuple[str, float]]:
        """The process and the time of each test that ran."""
        place = self.path / "processes"
        lines = place.read_text().splitlines() if place.is_file() else []
        return {name: (process, float(when)) for name, process, when in map(str.split, lines)}


@pytest.fixture
def tree(pytester, tmp_path, monkeypatch):
    monkeypatch.setenv("CI", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(ROOT), str(pytester.path))))
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    return Tree(pytester)


def test_the_first_reports_the_tests_of_both(tree):
    code, text = tree.run("--junitxml=out.xml", "--durations=3")
    where = tree.noted
    assert code == 1
    assert where["a"][0] == where["b"][0] == where["alone"][0]
    assert where["c"][0] == where["slow"][0] == where["fails"][0] != where["a"][0]
    assert where["alone"][1] > where["slow"][1], "it ran before the second process had ended"
    assert "1 failed, 6 passed, 1 skipped, 2 warnings" in text.splitlines()[-1]
    assert "AssertionError: two is wrong" in text and "UserWarning: what it warns of" in text
    assert re.search(r"SKIPPED \[1\] .*test_plain.py:\d+: no time", text), "the reason comes as it was"
    assert re.search(r"1\.\d+s call +tests/ch01/test_plain.py::test_slow", text)
    (suite,) = xml.parse(tree.path / "out.xml").getroot()
    counts = {name: suite.get(name) for name in ("tests", "failures", "skipped")}
    assert counts == {"tests": "8", "failures": "1", "skipped": "1"}
    assert re.search(r"^ch01 +- +6 +1 +1 ", text, re.MULTILINE), "the table counts all of them"
    assert "not run" not in text


def test_both_collect_at_once(tree):
    """Each waits, in the last file that it collects, until the other is there, too."""
    (tree.path / "tests" / "ch01" / "test_then.py").write_text(MEETING)
    code, text = tree.run("-k", "not fails")
    assert code == 0, text


def test_a_second_process_that_is_not_needed_after_all_runs_nothing(tree):
    """It was started while tests were collected of which most are then left out."""
    _, text = tree.run("-k", "test_b or test_slow")
    assert tree.noted.keys() == {"b", "slow"} and len({process for process, _ in tree.noted.values()}) == 1, (
        text
    )


@pytest.mark.parametrize(
    "words",
    [("--processes=1",), ("-s",), ("-k", "test_a or test_b or test_c"), ("tests/ch01/test_plain.py",)],
)
def test_one_process_runs_what_is_short_or_asked_of_one(tree, words):
    _, text = tree.run(*words)
    assert len({process for process, _ in tree.noted.values()}) == 1, text


def test_the_first_failure_ends_both(tree):
    tree.write(c="time.sleep(60)", b="wait('open'); assert 0")
    began = time.monotonic()
    code, text = tree.run("-x")
    assert code == 1 and time.monotonic() - began < 30
    assert "1 failed, 1 passed" in text.splitlines()[-1] and "stopping after 1 failures" in text
    assert "closed" in tree.noted


def test_a_failure_in_the_second_ends_the_first(tree):
    tree.write(c="assert 0", b="wait('closed'); time.sleep(0.2)")
    code, text = tree.run("-x")
    assert code == 1 and "alone" not in tree.noted
    assert "stopping after 1 failures" in text


def test_a_second_process_that_dies_fails_the_run(tree):
    tree.write(c="os._exit(7)")
    code, text = tree.run()
    assert code == 1 and "alone" in tree.noted
    where = "tests/ch01/test_plain.py::test_c"
    assert f"The second process ended in {where}, with exit code 7: 5 of its tests were not run." in text
    assert "5 tests were not run: the run ended before them." in text


def test_a_second_process_that_ends_long_before_the_first_is_waited_for_no_more(tree):
    tree.write(b="[one.join() for one in __import__('threading').enumerate() if one.name == 'reports']")
    last = tree.path / "tests" / "ch01" / "test_last.py"
    last.write_text(DRAWN.replace("test_a", "test_y").replace("test_b", "test_z"))
    code, text = tree.run()
    assert code == 1 and "alone" in tree.noted
    assert "1 failed, 8 passed, 1 skipped" in text.splitlines()[-1] and "not run" not in text


@pytest.mark.parametrize("first", ["time.sleep(60)", "pass"], ids=["runs a test", "waits for the second"])
@pytest.mark.parametrize("how", ["SIGINT", "SIGKILL"])
@pytest.mark.skipif(sys.platform == "win32", reason="it has no such signals")
def test_the_second_ends_with_the_first_and_closes_what_is_open(tree, how, first):
    tree.write(c="time.sleep(60)", b=first)
    with subprocess.Popen(
        [sys.executable, *COMMAND], cwd=tree.path, stdout=subprocess.PIPE, text=True
    ) as process:
        until(lambda: {"a", "open"} <= {*tree.noted} and ("b" in tree.noted or "sleep" in first))
        time.sleep(0.5)
        process.send_signal(getattr(signal, how))  # to the first alone
        text, _ = process.communicate(timeout=30)
    until(lambda: "closed" in tree.noted)
    if how == "SIGINT":
        assert process.returncode == 2 and "KeyboardInterrupt" in text


def test_packages_that_the_second_asks_for_are_written_by_the_first(tree):
    tree.write(c='importlib.util.find_spec("sci" + "py")')
    tree.run("--uses=uses")
    assert (tree.path / "uses" / "extras.txt").read_text() == "tests/ch01/test_plain.py\n"


def test_an_id_with_an_address_is_refused(tree):
    (tree.path / "tests" / "ch01" / "test_ids.py").write_text(
        "import pytest\n@pytest.mark.parametrize('one', [object()], ids=str)\ndef test_d(one): pass\n"
    )
    code, text = tree.run()
    assert code == pytest.ExitCode.USAGE_ERROR and not tree.noted
    assert re.search(
        r"test_ids.py::test_d\[<object object at 0x\w+>\]: each process has another address", text
    )


# What the report counts is written into a file. Two threads that hash work at once, so they work longer than it takes.
COUNTED = """
import hashlib, pytest, threading, time
BYTES = bytes(1 << 20)
if NAME == "drawn":
    pytestmark = pytest.mark.runs_on("vulkan")

def work(seconds=0.6):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        hashlib.sha256(BYTES)

def test_waits(): time.sleep(0.6)

def test_works(): work()

def test_threads():
    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
"""
COUNTING = """
def pytest_unconfigure(config):
    report = config.pluginmanager.getplugin("strata-report")
    if report and not sharing.is_second(config):
        lines = [f"{o.nodeid.rpartition('/')[2]} {o.seconds} {o.busy}" for o in report.outcomes.values()]
        Path("counted").write_text("\\n".join(lines))
"""


def test_to_a_chapter_counts_what_its_tests_work_in_either_process(tree):
    conftest = tree.path / "conftest.py"
    conftest.write_text(conftest.read_text() + COUNTING)
    for name in ("drawn", "plain"):
        file = tree.path / "tests" / "ch01" / f"test_{name}.py"
        file.write_text(f"NAME = {name!r}\n{COUNTED}")
    code, text = tree.run()
    assert code == 0, text
    counted = dict(line.split(" ", 1) for line in (tree.path / "counted").read_text().splitlines())
    assert len(counted) == 6
    for name, numbers in counted.items():
        seconds, busy = map(float, numbers.split())
        assert seconds > 0.6
        if name.endswith("waits"):
            assert busy < 0.3
        else:
            assert 0.55 < busy <= seconds


# --- which tests measure time -----------------------------------------------------------------------------------------

MEASURES = {"least_time", "least_times", "once_more"}


def measuring(text: str) -> list[str]:
    """Return the tests that measure a time again until it is below a bound, without the mark `alone`."""
    tree = ast.parse(text)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    used = {one.name: {n.id for n in ast.walk(one) if isinstance(n, ast.Name)} for one in functions}
    found = {*MEASURES}
    while more := {name for name, names in used.items() if names & found} - found:
        found |= more
    return [
        one.name
        for one in functions
        if one.name in found and one.name.startswith("test_") and "mark.alone" not in _marks(one)
    ]


def _marks(function: ast.FunctionDef) -> str:
    return " ".join(ast.unparse(one) for one in function.decorator_list)


def test_tests_that_measure_time_run_alone():
    files = [path for path in (ROOT / "tests").rglob("test_*.py") if path.name != "test_timing.py"]
    found = {path.name: names for path in files if (names := measuring(path.read_text("utf-8")))}
    assert found == {}, "mark them @pytest.mark.alone"


def test_a_test_that_measures_is_found_behind_a_helper():
    text = (
        "def helper():\n    least_time(work)\n"
        "def test_x():\n    helper()\n"
        "@pytest.mark.alone\ndef test_y():\n    helper()\n"
        "def test_z(): pass\n"
    )
    assert measuring(text) == ["test_x"]
