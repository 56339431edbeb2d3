"""`strata test --mutants`: what a mutant is, which tests are chosen for it, the limit of time, and what is kept."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import queue
import signal
import subprocess
import sys
import textwrap
import time
import types
from dataclasses import replace

import pytest

from common.errors import UserError
from common.paths import ROOT
from tests.support import mutant_glsl, mutant_map, mutant_texts, mutant_trees, mutants
from tests.support.clones import Clone
from tests.support.mutant_map import Map, Test, choose, nearest, tiers
from tests.support.mutant_texts import Mutant, applied
from tests.support.mutant_trees import MARK, Ran
from tools.ledger import testing

pytestmark = pytest.mark.needs("coverage")
Test.__test__ = False  # which is a dataclass here


def lines_of(text):
    """Return the mutants of a text as the lines that they change, stripped."""
    found = mutant_texts.mutants(text, "common/a.py")
    return [applied(text, one).splitlines()[one.line - 1].strip() for one in found]


@pytest.mark.parametrize(
    ("line", "others"),
    [
        ("x = a < b", ["x = a <= b"]),
        ("x = a >= b", ["x = a > b"]),
        ("x = a == b != c", ["x = a != b != c", "x = a == b == c"]),
        ("x = a is b", ["x = a is not b"]),
        ("x = a not in b", ["x = a in b"]),
        ("x = a + b", ["x = a - b"]),
        ("x = (a) * (b)", ["x = (a) / (b)"]),
        ("x = a // b", ["x = a * b"]),
        ("x = a | b", ["x = a & b"]),
        ("x <<= b", ["x >>= b"]),
        ("x = a and b and c", ["x = a or b and c", "x = a and b or c"]),
        ("x = not a", ["x = a"]),
        ("x = b * -a", ["x = b / -a", "x = b * a"]),
        ("x = f(-a)", ["x = f(a)"]),
        ("x = 41", ["x = 42"]),
        ("x = 0x0F", ["x = 0x10"]),
        ("x = 0.25", ["x = 0.5"]),
        ("x = True", ["x = False"]),
        ("x = 'key'", ["x = 'key_'"]),
        ("x = ''", ["x = '_'"]),
        ("x = {'ü': a < b}", ["x = {'ü_': a < b}", "x = {'ü': a <= b}"]),
        ("return a % 2", ["return a * 2", "return a % 3"]),
        ("f(key='n', flag=False)", ["f(key='n_', flag=False)", "f(key='n', flag=True)"]),
    ],
)
def test_each_kind_of_change(line, others):
    assert lines_of(f"def f(a, b, c):\n    {line}\n") == others


APART = {
    "docstrings": '"""text"""\nclass A:\n    """text"""\n    x: int\n    """text"""\n    def f(): "text"',
    "annotations": "x: 'A[1]'\ndef f(a: Literal['b'] = c, *, d: 3) -> Array[4]: pass",
    "type checkers' own": "if TYPE_CHECKING:\n    x = 1",
    "__all__": "__all__ = ['a', 'b']",
    "what is shown": "print('a', 1 + 2)\nsay('a')\nwarnings.warn('a')",
    "help": "Option(help='a', metavar='N', epilog='b')",
    "errors": "def f(n):\n    raise UserError('a' if n == 1 else f'{n + 1}')",
    "asserts": "def f(x):\n    assert x is not None, 'a'",
    "texts for people": "x = 'two words'\ny = f'{a + 1}'\nz = 'a' 'b'",
    "decorators": "@cache(64)\ndef f(): pass",
    "imports": "from __future__ import annotations\nimport a.b as c",
    "names": "T = TypeVar('T')\nx = cast('A', y)",
    "unions of types": "Path = str | bytes",
    "the last resort": "if __name__ == '__main__':\n    main(1)",
    "strict": "zip(a, b, strict=True)",
    "comments": "x = y  # a < b + 1",
}


@pytest.mark.parametrize("text", APART.values(), ids=APART)
def test_what_is_no_behaviour_stays(text):
    ast.parse(text)
    assert lines_of(text) == []


def test_a_mutant_knows_its_statement_and_its_function():
    text = textwrap.dedent("""\
        LIMIT = 4
        def f(a, b=2):
            if (a <
                    b):
                return [
                    3,
                ]
            return LIMIT
        """)
    found = {one.before: one for one in mutant_texts.mutants(text, "common/a.py")}
    assert (found["<"].line, found["<"].column, found["<"].span, found["<"].function) == (
        3,
        10,
        (3, 4),
        (3, 8),
    )
    assert (found["3"].span, found["3"].function) == ((5, 7), (3, 8))
    assert found["2"].function is None and found["2"].uses == {3, 4, 5, 6, 7, 8}
    assert found["4"].function is None and found["4"].uses == {8}


def test_a_change_of_another_text_is_refused():
    (one,) = mutant_texts.mutants("def f(a): return a < f\n", "common/a.py")
    with pytest.raises(ValueError, match="does not have '<' at 19"):
        applied("def f(a): return a > f\n", one)


def test_mutants_of_a_shader_are_in_its_functions():
    text = textwrap.dedent("""\
        #version 450
        layout(location = 0) in vec3 p;
        const float A = 1.0;
        struct S { float a[4]; };
        #define F(a) (a < 1)
        float f(float a) {  // a < 1
            if (a < 1e3 && !(a == -p.x)) { return a * 2.5f; }  /* 3
            4 */ return float(5u >> 6) - 0.5;
        }
        """)
    found = mutant_glsl.mutants(text, "shaders/a.glsl")
    said = [(one.line, one.change) for one in found]
    first = [
        "< → <=",
        "1e3 → 2000.0",
        "&& → ||",
        "! → nothing",
        "== → !=",
        "- → nothing",
        "* → /",
        "2.5f → 5.0f",
    ]
    second = ["5u → 6u", ">> → <<", "6 → 7", "- → +", "0.5 → 1.0"]
    assert said == [*((7, one) for one in first), *((8, one) for one in second)]
    for one in found:
        line = applied(text, one).splitlines()[one.line - 1]
        assert line != text.splitlines()[one.line - 1] and one.after in line


# --- the map and the choice -------------------------------------------------------------------------------------------


def made_map(clone, *entries):
    """Return a map of a repository: of each entry the file of tests, and by id its seconds and lines."""
    path = clone.folder / "map.jsonl"
    head = clone.git("rev-parse", "HEAD").strip()
    there = mutant_map.blobs(clone.folder, head)
    for file, tests in entries:
        rows = [
            {"id": f"{file}::{name}", "outcome": "passed", "setup": setup, "seconds": seconds, "lines": lines}
            for name, (setup, seconds, lines) in tests.items()
        ]
        with path.open("a") as stream:
            stream.write(mutant_map.entry(file, there[file], head, {}, rows))
    return Map(path, clone.folder, head)


@pytest.fixture
def clone(tmp_path):
    made = Clone(tmp_path, count=0, git=False)
    for name, text in {
        "../common/a.py": "LIMIT = 3\n\ndef f(x):\n    return x < LIMIT\n\ndef g(x):\n    return x + 1\n",
        "../common/b.py": "SIZE = 3\n",
        "../tests/common/test_a.py": "from common import a\n",
        "../tests/cli/test_all.py": "import common.a\n",
        "../tests/common/test_b.py": "\n",
    }.items():
        made.write(name, text)
    made.begin()
    return made


def of(file, text, before):
    return next(one for one in mutant_texts.mutants(text, file) if one.before == before)


def ids(tests):
    return [{one.partition("::")[2] for one in tier} for tier in tests]


def test_the_tests_of_a_line_are_those_that_run_it(clone):
    found = made_map(
        clone,
        ("tests/common/test_a.py", {"f": (0, 1, {"common/a.py": "4"}), "g": (0, 1, {"common/a.py": "7"})}),
        ("tests/cli/test_all.py", {"all": (0, 9, {"common/a.py": "1-4,6-7"})}),
        ("tests/common/test_b.py", {"b": (0, 1, {})}),
    )
    text = found.text(found.head, "common/a.py")
    assert ids(tiers(found, of("common/a.py", text, "<"), text)) == [{"f", "all"}]
    assert ids(tiers(found, of("common/a.py", text, "+"), text)) == [{"g", "all"}]
    assert ids(tiers(found, of("common/a.py", text, "+"), text, ["tests/common/test_a.py"])) == [{"g"}]
    # A constant has the tests of the line that uses it, of other functions, and of files that name its own.
    constant = ids(tiers(found, of("common/a.py", text, "3"), text))
    assert constant[:2] == [{"f", "all"}, {"f", "g", "all"}] and constant[-1] == {"f", "g", "all"}
    assert ids(tiers(found, of("common/b.py", "SIZE = 3\n", "3"), "SIZE = 3\n")) == [{"b"}]


def test_tests_in_a_file_that_is_named_after_the_mutants_come_first(clone):
    found = made_map(
        clone,
        ("tests/common/test_a.py", {"f": (0, 1, {"common/a.py": "4"}), "g": (0, 1, {"common/a.py": "7"})}),
        ("tests/common/test_b.py", {"b": (0, 1, {"common/a.py": "4"})}),
    )
    text = found.text(found.head, "common/a.py")
    mutant = of("common/a.py", text, "<")
    assert ids(tiers(found, mutant, text)) == [{"f", "b"}]
    assert ids(nearest(found, mutant, text)) == [{"f"}, {"f", "b"}]


def test_a_test_that_compares_hashes_kills_nothing(clone, monkeypatch):
    """It fails with each change of a file whose hash is recorded, whatever the change does."""
    for one in mutant_map.HASHES:
        file, _, name = one.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text("utf-8"), "it is there"
    monkeypatch.setattr(mutant_map, "HASHES", {"tests/common/test_a.py::hash"})
    rows = {"f": (0, 1, {"common/a.py": "4"}), "hash": (0, 0.1, {"common/a.py": "*"})}
    found = made_map(clone, ("tests/common/test_a.py", rows))
    text = found.text(found.head, "common/a.py")
    assert ids(tiers(found, of("common/a.py", text, "<"), text)) == [{"f"}]
    assert ids([found.named("common/a.py")]) == [{"f"}]


def test_a_line_that_no_test_runs_has_none(clone):
    found = made_map(clone, ("tests/common/test_a.py", {"f": (0, 1, {"common/a.py": "1-4"})}))
    text = found.text(found.head, "common/a.py")
    assert tiers(found, of("common/a.py", text, "+"), text) == []
    assert choose([]) == []


def test_lines_are_followed_when_a_file_changes_and_new_ones_count_as_their_function(clone):
    tests = {"f": (0, 1, {"common/a.py": "4"}), "g": (0, 1, {"common/a.py": "7"})}
    made_map(clone, ("tests/common/test_a.py", tests), ("tests/common/test_b.py", {"b": (0, 1, {})}))
    now = (
        "LIMIT = 3\n# more\n\ndef f(x):\n    y = x * 5\n    return x < LIMIT\n\ndef g(x):\n    return x + 1\n"
    )
    clone.write("../common/a.py", now)
    clone.write("../tests/common/test_b.py", "# changed\n")
    head = clone.commit("change")
    found = Map(clone.folder / "map.jsonl", clone.folder, head)
    assert found.missing(["tests/common/test_a.py", "tests/common/test_b.py"]) == ["tests/common/test_b.py"]
    for before, name in {"<": "f", "*": "f", "+": "g"}.items():
        assert ids(tiers(found, of("common/a.py", now, before), now)) == [{name}], before


def test_a_later_chapter_with_the_same_file_has_the_tests_of_the_earlier_one(tmp_path):
    clone = Clone(tmp_path, count=0, git=False)
    text = "def f(x):\n    return x < 1\n"
    for chapter in ("ch01", "ch02", "ch03"):
        clone.write(f"{chapter}/a.py", text + "# other\n" * (chapter == "ch03"))
    clone.write("../tests/ch01/test_a.py", "\n")
    clone.begin()
    lines = {"f": (0, 1, {"chapters/ch01/a.py": "2"})}
    found = made_map(clone, ("tests/ch01/test_a.py", lines))
    by_chapter = {
        chapter: tiers(found, of(f"chapters/{chapter}/a.py", text, "<"), text)
        for chapter in ("ch01", "ch02", "ch03")
    }
    names = {chapter: [*one[0]] if one else [] for chapter, one in by_chapter.items()}
    assert names == {
        "ch01": ["tests/ch01/test_a.py::f"],
        "ch02": ["tests/ch01/test_a.py::ch02::f"],
        "ch03": [],
    }


def test_a_shader_has_all_tests_of_the_modules_that_read_it(clone):
    clone.write("../shaders/a.glsl", "float f(float a) { return a * 2.0; }\n")
    clone.commit("shader")
    tests = {
        "x[vulkan]": (3, 1, {"shaders/a.glsl": "*"}),
        "y[vulkan]": (0, 1, {}),
        "x[gl]": (3, 1, {}),
    }
    found = made_map(clone, ("tests/common/test_a.py", tests))
    text = found.text(found.head, "shaders/a.glsl")
    mutant = mutant_glsl.mutants(text, "shaders/a.glsl")[0]
    assert ids(tiers(found, mutant, text)) == [{"x[vulkan]", "y[vulkan]"}]


def test_tests_that_have_the_words_of_a_mutant_come_before_others(clone):
    """The name of the function, or words of a string: in the test, or in a value of its file that it names."""
    clone.write("../common/k.py", 'def sharpen(x):\n    return x + 1\n\nKINDS = ("crimson", "ochre")\n')
    clone.write(
        "../tests/common/test_a.py",
        "COLORS = {'ochre'}\n\ndef test_s():\n    sharpen(1)\n\ndef test_o():\n    COLORS\n\ndef test_n():\n    pass\n",
    )
    clone.commit("words")
    lines = {"common/k.py": "1-4"}
    found = made_map(
        clone, ("tests/common/test_a.py", dict.fromkeys(("test_s", "test_o", "test_n"), (0, 1, lines)))
    )
    text = found.text(found.head, "common/k.py")
    everything = {"test_s", "test_o", "test_n"}
    assert ids(nearest(found, of("common/k.py", text, "+"), text)) == [{"test_s"}, everything]
    assert ids(nearest(found, of("common/k.py", text, '"ochre"'), text))[0] == {"test_o"}
    assert ids(nearest(found, of("common/k.py", text, '"crimson"'), text))[0] == everything


def test_of_each_file_the_nearest_test_is_first_and_the_time_is_kept():
    def tests(*rows):
        return {f"{name}": Test(name, setup, seconds, lines) for name, setup, seconds, lines in rows}

    near = tests(
        ("tests/a.py::wide", 0, 1, 500),
        ("tests/a.py::unit", 0, 2, 5),
        ("tests/b.py::wide", 0, 1, 900),
        ("tests/c.py::slow", 0, 30, 900),
    )
    # a.py's nearest, b.py's only one, c.py's does not fit beside them, and then the fast ones.
    assert choose([near], 6) == ["tests/a.py::unit", "tests/a.py::wide", "tests/b.py::wide"]
    assert choose([near], 60)[-1] == "tests/c.py::slow"
    far = tests(("tests/d.py::far", 0, 1, 1))
    assert choose([near, far], 6)[-1] == "tests/d.py::far", "what is nearer has its time first"
    # A module's set-up is needed whichever of its tests run, and once.
    module = tests(("tests/e.py::first[gl]", 8, 1, 9), ("tests/e.py::second[gl]", 0, 1, 9))
    assert choose([module], 9) == []
    assert len(choose([module], 10)) == 1
    assert len(choose([module], 11)) == 2


# --- runs -------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="process groups")
@pytest.mark.parametrize("apart", [False, True])
def test_at_the_limit_nothing_is_left_of_what_a_run_started(tmp_path, apart):
    """A child in the group is ended by that, and one that left it by its mark, which /proc shows."""
    if apart and not sys.platform.startswith("linux"):
        pytest.skip("no /proc")
    mark = "of this test" if apart else "of none"
    code = textwrap.dedent(f"""
        import subprocess, sys, time
        child = [sys.executable, "-c", "import time; time.sleep(60)"]
        number = subprocess.Popen(child, start_new_session={apart}).pid
        path = {str(tmp_path / "number")!r}
        open(path + ".new", "w").write(str(number))
        import os
        os.rename(path + ".new", path)
        time.sleep(60)
        """)
    process = subprocess.Popen(
        [sys.executable, "-c", code], start_new_session=True, env={**os.environ, MARK: "of this test"}
    )
    while not (tmp_path / "number").exists():
        time.sleep(0.01)
    child = int((tmp_path / "number").read_text())
    began = time.perf_counter()
    assert mutant_trees.wait(process, 0.1, mark) is None
    assert time.perf_counter() - began < 5
    assert process.returncode == -signal.SIGKILL
    assert not runs(child)


def runs(number):
    """Whether a process is there and has not ended: one that has may wait for its parent to ask."""
    for _ in range(100):
        state = subprocess.run(
            ["ps", "-o", "stat=", "-p", str(number)], capture_output=True, text=True
        ).stdout
        if not state.strip() or state.startswith("Z"):
            return False
        time.sleep(0.02)
    return True


MUTANT = Mutant("common/a.py", 1, 0, "<", "<=", (1, 1), (1, 1))


def ran(code, *, seconds=1.0, failed=(), passed=(), last="", **more):
    rows = [{"id": name, "outcome": "failed"} for name in failed]
    return Ran(code, seconds, (*rows, *({"id": name, "outcome": "passed"} for name in passed)), last, **more)


@pytest.mark.parametrize(
    ("with_mutant", "without", "result"),
    [
        ([ran(1, failed=["t::b"])], [ran(0)], ("killed", "t::b")),
        ([ran(-11, last="t::b")], [ran(0)], ("killed", "t::b")),
        ([ran(2, broken="t")], [], ("killed", "t")),
        ([ran(4)], [ran(0)], ("killed", "a module that every test imports")),
        ([ran(0, passed=["t::a", "t::b"])], [], ("survived", "2 tests")),
        ([ran(None, last="t::a")], [ran(0, seconds=29)], ("time-out", "in t::a; without the mutant 29 s")),
        ([ran(None, last="t::a")], [ran(0, seconds=31)], ("too slow", "2 tests, without the mutant 31 s")),
        ([ran(None, last="t::a")], [ran(None, seconds=60)], ("too slow", "2 tests, without the mutant 60 s")),
        # A test that fails without the mutant too says nothing: it is left out.
        (
            [ran(1, failed=["t::a"]), ran(0, passed=["t::b"])],
            [ran(1, failed=["t::a"])],
            ("survived", "1 test"),
        ),
        ([ran(4, unknown=("t::a",)), ran(0, passed=["t::b"])], [], ("survived", "1 test")),
        ([ran(4, unknown=("t::a", "t::b"))], [], ("survived", "not covered")),
        ([ran(5)], [], ("survived", "not covered")),
    ],
)
def test_what_a_run_says_of_a_mutant(with_mutant, without, result, tmp_path):
    shop = mutants.Workshop.__new__(mutants.Workshop)
    shop.limit_s, shop._sound, shop.devices = 60.0, set(), {}
    (tmp_path / "common").mkdir()
    (tmp_path / "common/a.py").write_text("whole")
    tree = types.SimpleNamespace(root=tmp_path)
    tree.changed = lambda file, text: mutant_trees.Tree.changed(tree, file, text)
    answers = {True: iter(with_mutant), False: iter(without)}
    shop._run = lambda tree, ids: next(answers[(tree.root / "common/a.py").read_text() == "mutant"])
    assert shop._outcome(tree, MUTANT, "mutant", ["t::a", "t::b"]) == result
    assert all(next(left, None) is None for left in answers.values())
    assert (tmp_path / "common/a.py").read_text() == "whole"


def test_a_test_that_only_the_mutant_brings_into_being_is_confirmed_by_that_of_the_chapter_before():
    """While two chapters have the same file, its tests run for the earlier one alone."""
    shop = mutants.Workshop.__new__(mutants.Workshop)
    asked, answers = [], iter([ran(4, unknown=("t/a.py::ch04::b",)), ran(0)])
    shop._run = lambda _, ids: (asked.append([*ids]), next(answers))[1]
    assert shop._plain(None, ["t/a.py::ch04::b", "t/a.py::b", "t/a.py::ch05::c"]).code == 0
    assert asked[1] == ["t/a.py::b", "t/a.py::ch05::c"]
    answers = iter([ran(1)])
    assert shop._plain(None, ["t/a.py::ch04::b"]).code == 1, "known to pytest: it is not replaced"


def test_a_file_that_ends_pytest_costs_no_other_file_its_lines():
    shop, asked = mutants.Workshop.__new__(mutants.Workshop), []
    shop._measured = lambda files: (asked.append(files), ran(2 if "b" in files else 0))[1]
    parts = shop._in_parts(["a", "b", "c"])
    assert [(files, mutants.measured(one)) for files, one in parts] == [
        (["a"], True),
        (["b"], False),
        (["c"], True),
    ]
    assert [files for files, _ in shop._in_parts(["a", "c"])] == [["a", "c"]], (
        "one process for all that end well"
    )
    assert asked == [["a", "b", "c"], ["a"], ["b"], ["c"], ["a", "c"]]


PROJECT = {
    ".gitignore": "out/\n.venv/\n__pycache__/\n",
    "pyproject.toml": "[tool.pytest.ini_options]\npythonpath = ['.']\n",
    "common/__init__.py": "",
    "common/sums.py": """\
def larger(a, b):
    return a if a > b else b

def twice(x):
    return x + x

def never(x):
    return not x
""",
    "tests/test_sums.py": """\
import subprocess, sys
from common.sums import larger

def test_larger():
    assert larger(2, 3) == larger(3, 2) == 3

def test_fails():
    assert larger(2, 3) == 2

def test_twice():
    code = "import sys; from common.sums import twice; sys.exit(twice(2))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 4
""",
}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The project as a clone, the workshop of its mutants with the map, and what was said of that."""
    if os.name != "posix":
        pytest.skip("process groups")
    root = tmp_path_factory.mktemp("small") / "clone"
    clone = Clone(root, count=0, git=False)
    for name, text in PROJECT.items():
        clone.write(f"../{name}", text)
    clone.begin()
    shop = mutants.Workshop(root, 2, ("common",), 30.0)
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        shop.measure(mutants.test_files(root, ()))
    yield clone, shop, said.getvalue()
    shop.stop()


@pytest.mark.needs("coverage")
def test_the_lines_of_tests_are_measured_in_the_processes_that_they_start_too(small):
    _, shop, said = small
    assert "without 1 test that failed" in said
    found = {line: {*shop.map.covering("common/sums.py", [line])} for line in (2, 5, 8)}
    assert found == {2: {"tests/test_sums.py::test_larger"}, 5: {"tests/test_sums.py::test_twice"}, 8: set()}


@pytest.mark.needs("coverage")
def test_the_mutants_of_a_small_project_and_their_record(small, capsys):
    """`>` may as well be `>=`: it survives. A process of a test runs the sum. No test runs the third function."""
    clone, shop, _ = small
    root = clone.folder
    verdicts = mutants.run(99, "", True, (), shop)
    assert {f"{one.mutant.line} {one.mutant.change}": (one.result, one.by) for one in verdicts} == {
        "2 > → >=": ("survived", "1 test"),
        "5 + → -": ("killed", "tests/test_sums.py::test_twice"),
        "8 not → nothing": ("survived", "not covered"),
    }
    assert clone.git("status", "--porcelain") == "?? docs/\n", "the clone's own files stay"
    record = json.loads((root / "docs/records/mutants.json").read_text())
    head = clone.git("rev-parse", "HEAD").strip()
    assert (record["commit"], record["seed"], record["n"], record["killed"]) == (head, head, 3, 1)
    assert sorted((one["line"], one["before"], one["after"]) for one in record["survivors"]) == [
        (2, ">", ">="),
        (8, "not", ""),
    ]
    assert "3 mutants: 1 killed, 2 survived." in capsys.readouterr().out


# --- the command and the record ---------------------------------------------------------------------------------------


def test_the_same_seed_draws_the_same_mutants(clone):
    shop = mutants.Workshop.__new__(mutants.Workshop)
    shop.root, shop.product, shop.commit = clone.folder, ("common",), clone.git("rev-parse", "HEAD").strip()
    shop.map = Map(clone.folder / "none", clone.folder, shop.commit)
    drawn = {seed: shop.draw(3, seed) for seed in ("a", "b", "c")}
    assert all(shop.draw(3, seed) == drawn[seed] for seed in drawn)
    assert len({tuple(one) for one in drawn.values()}) > 1
    everything = shop.draw(99, "a")
    assert len({*everything}) == len(everything) == 5, "none is drawn twice"


def test_a_mutant_that_survives_is_tried_with_the_tests_that_did_not_fit(clone):
    tests = {name: (0, 40, {"common/a.py": "4"}) for name in ("f", "g", "h")}
    made_map(clone, ("tests/common/test_a.py", tests))
    shop = mutants.Workshop.__new__(mutants.Workshop)
    shop.root, shop.commit = clone.folder, clone.git("rev-parse", "HEAD").strip()
    shop.map = Map(clone.folder / "map.jsonl", clone.folder, shop.commit)
    text = shop.text("common/a.py")
    mutant = of("common/a.py", text, "<")
    rounds = shop.rounds(mutant)
    assert [len(ids) for ids in rounds] == [1, 1, 1] and len({one for ids in rounds for one in ids}) == 3
    shop._trees, ran = queue.SimpleQueue(), []
    shop._trees.put(None)

    def tried(killing):
        ran.clear()
        shop._outcome = lambda tree, mutant, changed, ids: (
            ran.append(ids) or (("killed", ids[0]) if ids == killing else ("survived", "1 test"))
        )
        return shop._try(mutant, rounds)

    second = tried(rounds[1])
    assert (second.result, second.by, ran) == ("killed", rounds[1][0], rounds[:2])
    none = tried(None)
    assert (none.result, none.by, ran) == ("survived", "3 tests", rounds)
    assert shop._try(mutant, []).by == "not covered"


def test_tools_have_mutants_where_their_tests_are_named(clone):
    clone.write("../tools/t.py", "def f(x):\n    return x + 1\n")
    clone.commit("a tool")
    made_map(clone, ("tests/common/test_a.py", {"f": (0, 1, {"common/a.py": "4", "tools/t.py": "2"})}))
    shop = mutants.Workshop.__new__(mutants.Workshop)
    shop.root, shop.product = clone.folder, ("common", "tools")
    shop.commit = clone.git("rev-parse", "HEAD").strip()
    shop.map = Map(clone.folder / "map.jsonl", clone.folder, shop.commit)
    assert {one.file for one in shop.draw(99, "a")} == {"common/a.py", "common/b.py"}
    assert {one.file for one in shop.draw(99, "a", ["tests/common/test_a.py"])} == {
        "common/a.py",
        "tools/t.py",
    }


def test_a_file_that_a_chapter_carries_on_has_its_mutants_in_the_first_one(clone):
    for chapter, text in (("01", "A = 1\n"), ("02", "A = 1\n"), ("03", "A = 2\n"), ("04", "A = 1\n")):
        clone.write(f"../chapters/ch{chapter}/a.py", text)
    clone.write("../chapters/ch02/b.py", "B = 1\n")
    clone.begin()
    shop = mutants.Workshop.__new__(mutants.Workshop)
    shop.root, shop.product, shop.commit = clone.folder, ("chapters",), clone.git("rev-parse", "HEAD").strip()
    names = ["ch01/a.py", "ch02/b.py", "ch03/a.py", "ch04/a.py"]
    assert shop.sources() == [f"chapters/{name}" for name in names]


def test_each_survivor_of_the_record_has_a_reason():
    record = json.loads((ROOT / "docs/records/mutants.json").read_text("utf-8"))
    assert record["n"] >= 60 and record["survivors"]
    assert (
        record["killed"] + record["timeouts"] + record["too_slow"] + len(record["survivors"]) == record["n"]
    )
    assert [one["file"] for one in record["survivors"] if not one["reason"].endswith(".")] == []


def test_a_clone_with_changes_is_refused(clone):
    clone.write("../common/a.py", "changed = 1\n")
    with pytest.raises(UserError, match=r"common/a\.py differs from it: commit first"):
        mutants.Workshop(clone.folder, 1)
    assert not (clone.folder / "out").exists()


def verdict(line=4, **more):
    return mutants.Verdict(replace(MUTANT, line=line), "survived", "1 tests", 1.0, "return x < LIMIT", **more)


def test_the_reason_of_a_survivor_stays_while_its_line_does(clone):
    first = mutants.new_record([verdict()], {}, clone.folder, {"seed": "a"})
    assert (first["n"], first["killed"], first["survivors"][0]["reason"]) == (1, 0, "")
    first["survivors"][0]["reason"] = "the same for whole numbers"
    again = mutants.new_record([verdict(line=40)], first, clone.folder, {"seed": "a"})
    assert [(one["line"], one["reason"]) for one in again["survivors"]] == [
        (40, "the same for whole numbers")
    ]
    assert again["known"] == []
    later = mutants.new_record([], again, clone.folder, {"seed": "b"})
    assert (later["survivors"], len(later["known"])) == ([], 1)
    clone.write("../common/a.py", "\n")
    assert mutants.new_record([], later, clone.folder, {"seed": "c"})["known"] == []


@pytest.mark.parametrize(
    ("words", "files"),
    [
        (["tests/common/test_names.py"], ["tests/common/test_names.py"]),
        (["architecture"], ["tests/test_architecture.py"]),
        (["architecture", "tests/test_architecture.py"], ["tests/test_architecture.py"]),
    ],
)
def test_words_name_files_of_tests(words, files):
    assert mutants.test_files(ROOT, words) == files


def test_areas_and_no_words_name_many_files():
    assert "tests/common/test_names.py" in mutants.test_files(ROOT, ["common"])
    assert "tests/ch01/test_contract.py" in mutants.test_files(ROOT, ["1"])
    assert {"tests/ch01/test_contract.py", "tests/test_panel.py"} < {*mutants.test_files(ROOT, [])}


@pytest.mark.parametrize("word", ["-x", "tests/common/test_names.py::test_a", "comon", "tests/nothing"])
def test_other_words_are_refused(word):
    with pytest.raises(UserError):
        mutants.test_files(ROOT, [word])


@pytest.mark.parametrize(
    "words",
    [["--mutants", "3", "--long"], ["--mutants", "3", "--chapter", "1"], ["--seed", "a"], ["--jobs", "2"]],
)
def test_options_that_do_not_go_together_are_refused(words, strata):
    code, _, told = strata("test", *words)
    assert code == 2 and "leave" in told


@pytest.mark.skipif(os.name != "posix", reason="process groups")
def test_when_it_is_stopped_nothing_is_left(tmp_path, monkeypatch):
    """Ctrl-C reaches the command alone here, as from a program; the run that it started is in a group of its own."""
    path = tmp_path / "number"
    run = f"import os, time; open({str(path)!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    tool = textwrap.dedent(f"""
        import subprocess, sys
        from tests.support import mutant_trees, mutants

        class Shop:
            def __init__(self, root, jobs): self.cache = __import__("pathlib").Path({str(tmp_path)!r})
            def stop(self): mutant_trees.end(self.process, "none")

        def run(count, seed, record, words, shop):
            shop.process = subprocess.Popen([sys.executable, "-c", {run!r}], start_new_session=True)
            shop.process.wait()

        mutants.Workshop, mutants.run = Shop, run
        mutants.choice.probe = lambda api: None
        sys.exit(mutants.main(sys.argv[1:]))
        """)
    (tmp_path / "tool.py").write_text(tool)
    real = testing.subprocess.Popen

    class Interrupted(real):
        def wait(self, timeout=None):
            if not hasattr(self, "told"):
                self.told = True
                while not (path.exists() and path.read_text()):
                    assert self.poll() is None, "it ended before it was stopped"
                    time.sleep(0.01)
                raise KeyboardInterrupt
            return super().wait(timeout)

    def start(command, **more):
        return Interrupted([*command[:2], str(tmp_path / "tool.py"), *command[4:]], **more)

    monkeypatch.setattr(testing, "subprocess", types.SimpleNamespace(Popen=start))
    with pytest.raises(KeyboardInterrupt):
        testing.run_mutants(1, [], seed=None, jobs=None, record=False)
    assert not runs(int(path.read_text()))


def test_the_command_starts_the_tool_of_the_tests(monkeypatch):
    commands = []

    class Started(contextlib.nullcontext):
        def __init__(self, command, **more):
            commands.append(command)
            super().__init__(types.SimpleNamespace(wait=lambda: 0))

    monkeypatch.setattr(testing, "subprocess", types.SimpleNamespace(Popen=Started))
    assert testing.run_mutants(5, ["common"], seed="a", jobs=None, record=True) == 0
    assert commands[0][-5:] == ["tests.support.mutants", "--mutants=5", "--seed=a", "--record", "common"]
