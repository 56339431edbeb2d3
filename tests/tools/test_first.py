"""The first test of a chapter: its order, its end in time and at the first failure, and what it says."""

from __future__ import annotations

import re
import sys

import pytest

from common.errors import UserError
from common.paths import ROOT
from tests.support import first
from tools.ledger.testing import first_arguments, run

pytest_plugins = ["pytester"]

CONFTEST = f"""
import sys; sys.path.insert(0, {str(ROOT)!r})
import pytest
from pathlib import Path
from tests.support import first, snapshots

HERE = Path(__file__).parent

def pytest_addoption(parser):
    parser.addoption("--begin", type=float, default=60.0)

def pytest_configure(config):
    for mark in ("core", "until(number, why)"):
        config.addinivalue_line("markers", mark)
    config.pluginmanager.register(first.First(2, "2", config.getoption("--begin")))

@pytest.fixture(scope="module", params=["deferred", "without-all", "vulkan", "gl"])
def variant(request): return request.param

@pytest.fixture(scope="module")
def chapter(variant):
    yield variant
    print(f"CLOSED {{variant}}")
"""

CORE = """
import pytest
pytestmark = pytest.mark.core

@pytest.mark.parametrize("scene", ["atrium", "square"])
def test_scene(chapter, scene): pass
"""
CONTRACT = """
import pytest
pytestmark = pytest.mark.core
def test_contract(chapter): pass
"""
OWN = """
import pytest
def test_drawn(chapter): pass
def test_plain(): pass
"""
EARLIER = "def test_old(): pass\n"


@pytest.fixture
def suite(pytester, monkeypatch):
    """Tests of two chapters; return what runs them and gives (exit code, text)."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name, text in {
        "ch01/test_a.py": CORE,
        "ch01/test_contract.py": CONTRACT,
        "ch01/test_old.py": EARLIER,
        "ch02/test_own.py": OWN,
    }.items():
        path = pytester.path / "tests" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    pytester.makeconftest(CONFTEST)

    def go(*words: str) -> tuple[int, str]:
        done = pytester.runpytest_subprocess(
            "-v", "-s", "-x", "--import-mode=importlib", "-p", "no:cacheprovider", *words, "tests"
        )
        return done.ret, done.stdout.str()

    return go


def ran(text: str) -> list[str]:
    """Return the tests in the order in which they ran."""
    return re.findall(r"^tests/[^:\s]+::(\S+) (?:PASSED|FAILED|CLOSED)", text, re.MULTILINE)


def test_a_frame_of_each_variant_comes_first_and_large_scenes_late(suite):
    code, text = suite()
    assert code == 0
    variants = ["vulkan", "gl", "without-all", "deferred"]
    assert ran(text) == [
        *(f"test_contract[{variant}]" for variant in variants),
        *(f"test_scene[{variant}-square]" for variant in variants),
        "test_plain",
        *(f"test_drawn[{variant}]" for variant in variants),
        *(f"test_scene[{variant}-atrium]" for variant in variants),
        "test_old",
    ]
    assert "were not begun" not in text


def test_the_first_failure_ends_it_and_the_sentence_names_the_rest(suite, pytester):
    (pytester.path / "tests" / "ch01" / "test_contract.py").write_text(CONTRACT.replace("pass", "assert 0"))
    code, text = suite()
    assert code == 1 and ran(text) == ["test_contract[vulkan]"]
    assert (
        "This was a first test of chapter 2. All of it: ./strata test 2; everything: ./strata test." in text
    )
    assert text.strip().splitlines()[-1].strip("= ").startswith("1 failed")


SLOW = """
import time
def test_a(chapter): time.sleep(1.0)
def test_b(): pass
"""


def test_no_test_begins_after_its_time_and_what_is_open_is_closed(suite, pytester):
    for name in ("ch01/test_a.py", "ch01/test_contract.py", "ch01/test_old.py"):
        (pytester.path / "tests" / name).unlink()
    path = pytester.path / "tests" / "ch02" / "test_own.py"
    path.write_text(
        SLOW.replace("(chapter)", "(tmp_path, chapter)") + "def test_c(chapter): time.sleep(1.0)\n"
    )
    code, text = suite("--begin=0.5", "-k", "test_b or deferred or vulkan")
    assert code == 0, text
    assert "The time of a first test is over: 3 tests were not begun." in text
    assert "2 passed" in text.splitlines()[-1]
    assert "CLOSED vulkan" in text


def test_what_fails_while_it_closes_fails_the_run(suite, pytester):
    path = pytester.path / "conftest.py"
    path.write_text(path.read_text().replace("print(f", "raise RuntimeError(f"))
    for name in ("ch01/test_contract.py", "ch01/test_old.py"):
        (pytester.path / "tests" / name).unlink()
    (pytester.path / "tests" / "ch01" / "test_a.py").write_text(
        CORE.replace("pass", "__import__('time').sleep(1)")
    )
    code, text = suite("--begin=0.5", "-k", "test_scene and vulkan")
    assert code == 1 and "CLOSED vulkan" in text
    assert "1 passed" in text.splitlines()[-1] and "1 error" in text.splitlines()[-1]


# --- its words --------------------------------------------------------------------------------------------------------


def test_words_of_the_first_test():
    arguments = first_arguments("3", ["-k", "alpha"])
    assert arguments[0] == "tests/ch03" and arguments[-5:] == ["--chapter=3", "--first", "-x", "-k", "alpha"]
    core = arguments[1:-5]
    assert {"tests/ch01/test_contract.py", "tests/stability/test_ch01.py"} <= {*core}
    assert "tests/ch01/test_packing.py" not in core, "it has no test of the core"
    assert all((ROOT / path).is_file() for path in core)
    assert first_arguments("ch01", [])[0] == "tests/ch01"


@pytest.mark.parametrize("word", ["ch01", "tests/ch01/test_contract.py", "common"])
def test_areas_and_paths_are_refused_beside_it(word):
    with pytest.raises(UserError, match=rf"--chapter 3 is a first test of one chapter: leave out '{word}'"):
        run([word], chapter="3")


@pytest.mark.parametrize("option", ["long", "bless", "record"])
def test_options_of_whole_runs_are_refused_beside_it(option):
    with pytest.raises(UserError, match="--chapter is a first test, which ends early"):
        run([], chapter="3", **{option: True})


def test_the_command_line_passes_it_on(strata, monkeypatch):
    calls = []
    monkeypatch.delenv("CI", raising=False)  # there the static checks are commands, too
    monkeypatch.setattr("tools.ledger.testing.subprocess.run", lambda words, **_: calls.append(words) or Done)
    assert strata("test", "--chapter", "2", "-k", "alpha")[0] == 0
    assert strata("test", "--chapter=2")[0] == 0
    prefix = [sys.executable, "-P", "-m", "pytest"]
    assert calls[0] == [*prefix, *first_arguments("2", ["-k", "alpha"])]
    assert calls[1] == [*prefix, *first_arguments("2", [])]
    code, _, said = strata("test", "--chapter", "99")
    assert code == 2 and said.count("\n") == 1
    assert "--chapter" in strata("test", "--help")[1]


class Done:
    returncode = 0


def test_the_time_is_what_is_promised():
    """The last test to begin may take 20 s with nothing compiled; the starts of Python and pytest take the rest."""
    from tests.support.report import COLD_TEST_BUDGET_S

    assert first.BEGIN_S + COLD_TEST_BUDGET_S + 5.0 <= first.MOST_S
