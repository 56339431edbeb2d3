"""Tests of a chapter run for later chapters: on small trees of three lessons, of which each adds its number."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from common.paths import ROOT
from tests.support import contents
from tests.support.snapshots import Snapshots, Subject, first_chapter, load_for, official, turn_of

pytest_plugins = ["pytester"]

CONFTEST = """
import sys
from pathlib import Path
TREE = Path(__file__).parent
sys.path.insert(0, str(TREE))
import pytest
from tests.support import sharing, snapshots
from tests.support.report import Report

def pytest_addoption(parser):
    parser.addoption("--long", action="store_true")
    parser.addoption("--full", action="store_true")
    sharing.add_options(parser)
    snapshots.add_options(parser)

def pytest_configure(config):
    for mark in ("feature(slug)", "long", "core", "newest", "until(number, why)"):
        config.addinivalue_line("markers", mark)
    names = {number: f"ch0{number}" for number in (1, 2, 3)}
    lessons = [snapshots.Subject(n, f"lessons.{name}", TREE / "lessons" / name) for n, name in names.items()]
    chosen = [lessons[int(number) - 1] for number in config.getoption("--chapter")]
    later = snapshots.Snapshots(lessons, chosen, config.getoption("--long"), config.getoption("--full"))
    config.pluginmanager.register(later, "strata-snapshots")
    config.pluginmanager.register(Report(config), "strata-report")

def pytest_generate_tests(metafunc):
    if "variant" in metafunc.fixturenames:
        later = metafunc.config.pluginmanager.getplugin("strata-snapshots")
        metafunc.parametrize("variant", later.variants_for(metafunc.definition, ("a", "b", "c")))

@pytest.fixture(scope="module")
def chapter(request):
    return snapshots.tested(request.node).number
"""

UNIT = """
import pytest
from lessons.ch01.logic.numbers import NUMBER, double

def test_number():
    assert double(NUMBER) == 2
"""

DRAWN = """
import pytest
from lessons.ch01.renderer import CHAPTER
import lessons.ch01.renderer as renderer
PROGRAM = "from lessons.ch01.renderer import CHAPTER"

@pytest.mark.core
def test_core(chapter):
    space = {}
    exec(PROGRAM, space)
    assert chapter == CHAPTER == renderer.CHAPTER == space["CHAPTER"]

def test_rest(chapter):
    assert chapter == CHAPTER

@pytest.mark.until(2, "the third lesson draws otherwise")
@pytest.mark.core
def test_ends(chapter):
    assert chapter < 3
"""

TURNS = """
import pytest
from lessons.ch01.renderer import CHAPTER

@pytest.mark.core
def test_core(variant): pass

@pytest.mark.core
def test_other(variant): pass

@pytest.mark.newest
def test_newest(variant): pass
"""

ENDS = """
import pytest
from lessons.ch01.logic.removed import GONE
pytestmark = pytest.mark.until(1, "the second lesson has none")

def test_gone():
    assert GONE
"""


@pytest.fixture
def tree(pytester, tmp_path, monkeypatch):
    """Three lessons and their tests: chapter 2 equals chapter 1 but for its number and a removed file; in chapter 3
    `NUMBER` differs."""
    for number in (1, 2, 3):
        folder = pytester.path / "lessons" / f"ch0{number}"
        (folder / "logic").mkdir(parents=True)
        for place in (folder, folder / "logic"):
            (place / "__init__.py").write_text("")
        (folder / "renderer.py").write_text(f"CHAPTER = {number}\nfrom .logic import numbers\n")
        (folder / "logic" / "numbers.py").write_text(
            f"from ..base import double\nNUMBER = {1 if number < 3 else 4}\n"
        )
        (folder / "base.py").write_text("def double(x): return 2 * x\n")
    (pytester.path / "lessons" / "ch01" / "logic" / "removed.py").write_text("GONE = True\n")
    (pytester.path / "lessons" / "__init__.py").write_text("")
    tests = pytester.path / "tests" / "ch01"
    tests.mkdir(parents=True)
    (tests / "test_unit.py").write_text(UNIT)
    (tests / "test_drawn.py").write_text(DRAWN)
    (tests / "test_ends.py").write_text(ENDS)
    pytester.makeconftest(CONFTEST)
    monkeypatch.setenv("CI", "")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))  # the run within keeps its results there
    return pytester


def outcomes(tree, *words: str) -> tuple[dict[str, str], str]:
    """Run pytest in the tree; return {"file::chNN::test": "PASSED"} and all that it printed.

    In a process of its own: within this one it would collect the garbage that hundreds of drivers' tests left behind.
    """
    done = tree.runpytest_subprocess("--import-mode=importlib", "-v", "-p", "no:cacheprovider", *words)
    text = done.stdout.str() + done.stderr.str()
    return {m[1]: m[2] for m in re.finditer(r"^tests/ch01/(\S+) (PASSED|FAILED)", text, re.MULTILINE)}, text


def test_a_core_runs_for_every_chapter_and_equal_modules_once(tree):
    ran, text = outcomes(tree, "tests")
    assert ran == {
        "test_unit.py::test_number": "PASSED",
        "test_unit.py::ch03::test_number": "FAILED",  # chapter 2 has the same modules, chapter 3 broke one
        "test_drawn.py::test_core": "PASSED",
        "test_drawn.py::ch02::test_core": "PASSED",
        "test_drawn.py::ch03::test_core": "PASSED",
        "test_drawn.py::test_rest": "PASSED",
        "test_drawn.py::test_ends": "PASSED",
        "test_drawn.py::ch02::test_ends": "PASSED",
        "test_ends.py::test_gone": "PASSED",
    }
    assert "assert 8 == 2" in text, "the assertion tells its values"
    assert "where 8 = double(4)" in text
    assert "without 1 tests of modules that are the same" in text
    assert "without 2 tests that draw" in text
    assert "without 1 tests and 2 whole files of what a later lesson replaces" in text
    counts = {line.split()[0]: line.split()[2:4] for line in text.splitlines() if re.match(r"ch\d\d ", line)}
    assert counts == {"ch01": ["5", "0"], "ch02": ["2", "0"], "ch03": ["1", "1"]}


def test_a_module_is_made_only_for_a_chapter_that_runs_something_of_it(tree):
    path = tree.path / "tests" / "ch01" / "test_unit.py"
    path.write_text(f"{UNIT}\nwith open('made', 'a') as file: file.write(double.__module__ + ' ')\n")
    outcomes(tree, "tests")
    assert (tree.path / "made").read_text().split() == ["lessons.ch01.base", "lessons.ch03.base"]


def test_one_chapter_alone_and_what_takes_long(tree):
    ran, _ = outcomes(tree, "tests", "--chapter=2")
    assert {*ran} == {"test_drawn.py::ch02::test_core", "test_drawn.py::ch02::test_ends"}
    ran, _ = outcomes(tree, "tests", "--chapter=2", "--long")
    assert {*ran} == {f"test_drawn.py::ch02::test_{name}" for name in ("core", "ends", "rest")}
    assert {*ran.values()} == {"PASSED"}


VARIANTS = ("a", "b", "c")


def in_turns(tree, *words: str) -> dict[str, set[str]]:
    """Return the variants in which each test of turns ran: {"ch02::test_core": {"a"}}."""
    (tree.path / "tests" / "ch01" / "test_turns.py").write_text(TURNS)
    ran, _ = outcomes(tree, "tests/ch01/test_turns.py", *words)
    found: dict[str, set[str]] = {}
    for name in ran:
        test, _, variant = name.removeprefix("test_turns.py::").partition("[")
        found.setdefault(test, set()).add(variant.rstrip("]"))
    return found


def test_a_core_test_takes_turns_and_the_newest_chapter_has_them_all(tree):
    every, found = {*VARIANTS}, in_turns(tree)
    assert found["test_core"] == found["test_other"] == found["test_newest"] == every
    assert found["ch03::test_core"] == found["ch03::test_other"] == found["ch03::test_newest"] == every
    assert "ch02::test_newest" not in found
    for name in ("test_core", "test_other"):
        assert found[f"ch02::{name}"] == {VARIANTS[turn_of(f"ch01/test_turns.py::{name}", 2) % 3]}


def test_the_report_has_a_budget_for_what_takes_turns_alone(tree):
    text = f"from tests.support import report\nreport.CORE_BUDGET_S = -1.0\n{TURNS}"
    (tree.path / "tests" / "ch01" / "test_turns.py").write_text(text)
    _, text = outcomes(tree, "tests/ch01/test_turns.py")
    assert re.findall(r"(ch\d\d) \S+ took .* for core tests", text) == ["ch02"]


@pytest.mark.parametrize("word", ["--long", "--full"])
def test_all_variants_run_where_that_is_asked_for(tree, word):
    found = in_turns(tree, word, "--chapter=2")
    assert found == {f"ch02::test_{name}": {*VARIANTS} for name in ("core", "other", "newest")}


def test_a_turn_is_the_same_in_every_process_and_another_one_in_the_next_chapter():
    assert turn_of("123456789", 0) == 0xCBF43926, (
        "the check value of CRC-32, which no seed of a process changes"
    )
    assert len({turn_of("ch01/test_a.py::test_b", chapter) % 3 for chapter in (7, 8, 9)}) == 3


def core_of(folder: Path) -> list[str]:
    """Return the functions that are marked `core` in a folder of tests; a whole file cannot be."""
    found = []
    for path in sorted(folder.rglob("test_*.py")):
        for node in contents.syntax(path).body:
            marks = " ".join(ast.unparse(one) for one in getattr(node, "decorator_list", []))
            found += [f"{path.name}::{node.name}"] if "mark.core" in marks else []
            assert not (isinstance(node, ast.Assign) and "mark.core" in ast.unparse(node)), path
    return found


@pytest.mark.parametrize("subject", official(), ids=lambda one: one.label)
def test_a_lesson_has_three_to_five_core_tests(subject):
    assert 3 <= len(core_of(ROOT / "tests" / subject.label)) <= 5


def test_ids_select(tree):
    ran, _ = outcomes(tree, "tests/ch01/test_drawn.py::ch03::test_core")
    assert {*ran} == {"test_drawn.py::ch03::test_core"}
    ran, _ = outcomes(tree, "tests/ch01/test_drawn.py::test_core", "tests/ch01/test_unit.py")
    assert {*ran} == {
        *("test_drawn.py::test_core", "test_unit.py::test_number", "test_unit.py::ch03::test_number")
    }
    ran, _ = outcomes(tree, "tests", "-k", "ch02 and test_core")
    assert {*ran} == {"test_drawn.py::ch02::test_core"}


def test_an_end_without_a_reason_is_refused(tree):
    path = tree.path / "tests" / "ch01" / "test_drawn.py"
    path.write_text(DRAWN.replace('(2, "the third lesson draws otherwise")', "(2)"))
    _, text = outcomes(tree, "tests")
    assert "write until(1, 'why a later chapter differs')" in text


def test_a_module_that_is_gone_says_what_to_mark(tree):
    path = tree.path / "tests" / "ch01" / "test_ends.py"
    path.write_text(ENDS.replace("pytestmark", "unmarked"))
    _, text = outcomes(tree, "tests", "--chapter=2")
    assert "test_ends.py::ch02: No module named 'lessons.ch02.logic.removed'" in text
    assert "mark it: pytestmark = pytest.mark.until(" in text


# --- parts of it ------------------------------------------------------------------------------------------------------


def test_files_know_their_chapter():
    assert first_chapter(Path("tests/ch07/test_a.py")) == 7
    assert first_chapter(Path("tests/stability/test_ch03.py")) == 3
    for other in ("tests/reference/test_ch01.py", "tests/common/test_a.py", "tests/ch01/deep/test_a.py"):
        assert first_chapter(Path(other)) is None


def test_every_kind_of_import_leads_to_the_other_package(tmp_path):
    text = (
        "import chapters.ch01.settings\nfrom chapters import ch01\nfrom chapters.ch01 import LESSON\n"
        "from chapters.ch01.settings import Settings as S\n"
        "from chapters.ch01.studies import reflection_refraction as own\n"
        "found = {chapters.ch01.settings.__name__, ch01.__name__, S.__module__, 'chapters.ch01.x', 'chapters.ch011'}\n"
        "kept = {own.__name__, 'chapters.ch01.benches.x'}\n"
        "number = LESSON.number\n"
    )
    path = tmp_path / "imports.py"
    path.write_text(text)
    module = load_for(path, "chapters.ch01", "chapters.ch02", "imports@ch02", None)
    assert module.number == 2
    names = {"chapters.ch02.settings", "chapters.ch02", "chapters.ch02.x", "chapters.ch011"}
    assert module.found == names
    assert module.kept == {"chapters.ch01.studies.reflection_refraction", "chapters.ch01.benches.x"}


def test_a_digest_is_of_what_a_test_leads_to_and_of_nothing_else(tmp_path):
    """Modules, theirs in turn, and shaders where one is named; studies, benches and other modules are no part."""
    test, logic, draws = (tmp_path / name for name in ("test_a.py", "test_b.py", "test_c.py"))
    test.write_text("from chapters.ch01.shading.sky import draw\nfrom chapters.ch01.benches.b import B\n")
    logic.write_text("def test_x():\n    from chapters.ch01.logic import numbers\n")
    draws.write_text("def test_x(chapter): pass\n")
    files = {
        "shading/sky.py": "from ..logic.numbers import ONE\nSHADER = 'sky.frag'\n",
        "logic/numbers.py": "ONE = 1\n",
        "shading/sky.frag": "void main() {}\n",
        "renderer.py": "from . import LESSON\n",
        "README.md": "words\n",
        "studies/a.py": "A = 1\n",
        "benches/b.py": "B = 1\n",
        "__init__.py": "LESSON = 1\n",
    }

    def digests(number: int, changed: str = "") -> list[str]:
        folder = tmp_path / f"tree{number}"
        for name, text in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text + "# more\n" * (name == changed))
        return [contents.digest(path, "chapters.ch01", folder) for path in (test, logic, draws)]

    same = digests(0)
    assert len({*same}) == 3
    expected = {
        "shading/sky.py": [False, True, False],
        "logic/numbers.py": [False, False, False],
        "shading/sky.frag": [False, True, False],
        "renderer.py": [True, True, False],
        "README.md": [True, True, True],
        "studies/a.py": [True, True, True],
        "benches/b.py": [True, True, True],
        "__init__.py": [True, True, False],
    }
    for number, (name, equal) in enumerate(expected.items(), 1):
        found = [a == b for a, b in zip(digests(number, name), same, strict=True)]
        assert found == equal, name


def test_the_chapters_that_are_here_are_tested():
    subjects = official()
    assert subjects[0] == Subject(1, "chapters.ch01", ROOT / "chapters" / "ch01", 1)
    later = Snapshots(subjects).further(ROOT / "tests" / "ch01" / "test_materials.py")
    assert [subject.label for subject in later] == [f"ch{s.number:02d}" for s in subjects[1:]]
