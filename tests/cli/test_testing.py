"""`strata test`: what its words become for pytest, and what a run reports, allows and bounds."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from common.errors import UserError
from common.paths import ROOT
from tests.support import oracles, report
from tests.support.report import (
    ALLOWED_SKIPS,
    Outcome,
    allowed_skips,
    feature_counts,
    is_allowed,
    over_budget,
    summary,
)
from tools.ledger import results
from tools.ledger.testing import areas, pytest_arguments

CHAPTER = ["tests/ch01", "tests/stability/test_ch01.py", "--chapter=1"]


@pytest.mark.parametrize(
    ("words", "arguments"),
    [
        ([], []),
        (["ch01"], CHAPTER),
        (["1"], CHAPTER),
        (["ch01", "common", "1"], [*CHAPTER, "tests/common"]),
        (["common", "-x"], ["tests/common", "-x"]),
        (["architecture"], ["tests/test_architecture.py"]),
        (["ch01", "-k", "alpha"], [*CHAPTER, "-k", "alpha"]),
        (["-k", "common", "ch01"], ["-k", "common", *CHAPTER]),
        (["--bless", "--yes", "ch01"], ["--bless", "--yes", *CHAPTER]),
        (["-x", "ch01"], ["-x", *CHAPTER]),
        (["tests/ch01/test_contract.py::test_x"], ["tests/ch01/test_contract.py::test_x"]),
        (["--durations=5", "shaders"], ["--durations=5", "tests/shaders"]),
    ],
)
def test_words_become_arguments(words, arguments):
    assert pytest_arguments(words) == arguments


def test_a_later_chapter_is_tested_by_the_tests_of_those_before_it_too():
    arguments = pytest_arguments(["2"])
    assert [*CHAPTER[:2], "--chapter=2"] == [word for word in arguments if "ch02" not in word]
    both = pytest_arguments(["ch01", "ch02"])
    assert len(both) == len({*both})
    assert {"--chapter=1", "--chapter=2"} < {*both}


def test_every_area_is_a_folder_of_tests():
    assert {"ch01", "common", "backends", "cli", "launcher", "shaders", "stability"} <= set(areas())


@pytest.mark.parametrize("word", ["ch1", "chapter", "99", "sahders"])
def test_an_unknown_area_suggests_the_near_one(word):
    with pytest.raises(UserError, match=r"There are no tests called .*([^?][.]|[?])$"):
        pytest_arguments([word])


def outcome(nodeid="tests/ch01/test_a.py::test_b[vulkan]", **more):
    made = Outcome(nodeid, more.pop("features", ()), more.pop("long", False), result="passed")
    for name, value in more.items():
        setattr(made, name, value)
    made.busy = more.get("busy", made.seconds)
    return made


def test_outcomes_know_their_area_and_variant():
    assert (outcome().area, outcome().variant) == ("ch01", "vulkan")
    stability = outcome("tests/stability/test_ch01.py::test_c[without-all-x]")
    assert (stability.area, stability.variant) == ("ch01", "without-all")
    alone = outcome("tests/test_architecture.py::test_d")
    assert (alone.area, alone.variant) == ("architecture", "-")


def test_a_test_that_runs_for_a_later_chapter_counts_there():
    later = outcome("tests/ch01/test_a.py::ch02::test_b[gl-x]", reason="Skipped: no Vulkan here")
    assert (later.area, later.variant) == ("ch02", "gl")
    stability = outcome("tests/stability/test_ch01.py::ch02::test_c[vulkan]")
    assert (stability.area, stability.variant) == ("ch02", "vulkan")
    assert is_allowed(later, [("tests/ch01/test_a.py::test_b*", "no Vulkan")])
    assert not is_allowed(outcome(reason="no Vulkan"), [("tests/ch01/test_a.py::ch02::*", "no Vulkan")])
    budget = over_budget([outcome(seconds=20.0, long=False), replace(later, seconds=20.0)])
    assert [text for text in budget if "a variant" in text] == []


def test_budgets_are_for_single_tests_and_for_areas_by_variant():
    quick = [outcome(seconds=4.0) for _ in range(6)]
    assert over_budget(quick) == []
    (text,) = over_budget([*quick, outcome(seconds=4.0)])
    assert "ch01 (vulkan) took 28.0 s" in text
    (text,) = over_budget([outcome(seconds=5.5)])
    assert "test_b[vulkan] took 5.5 s" in text
    assert over_budget([outcome(seconds=500.0, long=True)]) == []
    other = [outcome("tests/ch01/test_a.py::test_b[gl]", seconds=4.0) for _ in range(6)]
    assert over_budget([*quick, *other]) == []
    assert over_budget([*quick, outcome(seconds=4.0, busy=0.5)]) == [], "it waited, or shared its core"
    common = [outcome("tests/common/test_a.py::test_b", seconds=4.0) for _ in range(20)]
    assert over_budget(common) == [], "what is no chapter has no budget but that of each test"
    assert over_budget([*quick, *quick], cold=True) == []
    assert len(over_budget([*quick, *quick, *quick, *quick[:4]], cold=True)) == 1
    assert over_budget([*quick, *quick], shared=True) == []
    assert len(over_budget([*quick, *quick, *quick], shared=True)) == 1
    assert len(over_budget([outcome(seconds=20.5)], cold=True)) == 1


def test_tests_of_lessons_before_have_as_much_as_those_of_the_newest_chapter():
    own = [outcome("tests/ch03/test_a.py::test_b[gl]", seconds=4.0) for _ in range(6)]
    before = [outcome("tests/ch01/test_a.py::ch03::test_b[gl]", seconds=4.0) for _ in range(6)]
    assert over_budget([*own, *before]) == []
    (text,) = over_budget([*own, *before, before[0]])
    assert text == "ch03 (gl) took 28.0 s for tests of chapters before it; they may take 25 s a variant"
    (text,) = over_budget([*own, *before, own[0]])
    assert text == "ch03 (gl) took 28.0 s for its own tests; they may take 25 s a variant"


def test_core_tests_that_take_turns_have_a_budget_of_their_own():
    core = [outcome("tests/ch01/test_a.py::ch03::test_b[gl]", seconds=2.0, turn=True) for _ in range(3)]
    assert over_budget([*core, outcome("tests/ch03/test_a.py::test_b[gl]", seconds=4.0)]) == []
    assert over_budget([*core, replace(core[0], nodeid="tests/ch01/test_a.py::ch03::test_b[vulkan]")]) == []
    (text,) = over_budget([*core, core[0]])
    assert text.startswith("ch03 (gl) took 8.0 s for core tests of chapters before it; they may take 6 s")
    assert over_budget([*core, *core], cold=True) == []
    (text,) = over_budget([*core, *core, *core, *core[:2]], cold=True)
    assert "they may take 21 s" in text


def test_the_record_keeps_the_last_result_of_every_long_test(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "LONG_RECORD", tmp_path / "long.json")
    name = "tests/cli/test_testing.py::test_{}"
    head = {"commit": "old"}
    before = [outcome(name.format(x), long=True, result="passed") for x in "ab"]
    gone = outcome("tests/no/such/test_file.py::test_c", long=True, result="passed")
    report.LONG_RECORD.write_text(json.dumps(report.long_record([*before, gone], head)))
    again = outcome(name.format("b"), long=True, result="failed")
    idle = [
        outcome(name.format("a"), long=True, result="not run"),
        outcome(name.format("d"), result="passed"),
    ]  # not run; not long
    tests = report.long_record([again, *idle], {"commit": "new"})["tests"]
    found = {key: (one["result"], one["commit"]) for key, one in tests.items()}
    assert found == {name.format("a"): ("passed", "old"), name.format("b"): ("failed", "new")}


def test_only_written_skips_are_allowed():
    allowed = allowed_skips("# why\n\ntests/ch01/*::test_b* | no Vulkan\n tests/x.py::* |\n")
    assert allowed == [("tests/ch01/*::test_b*", "no Vulkan"), ("tests/x.py::*", "")]
    assert is_allowed(outcome(reason="Skipped: no Vulkan here"), allowed)
    assert not is_allowed(outcome(reason="Skipped: no time"), allowed)
    assert not is_allowed(outcome("tests/ch01/test_a.py::test_c", reason="no Vulkan"), allowed)
    assert not is_allowed(outcome("tests/x.py::test_y", reason="anything"), allowed), (
        "a reason must be written"
    )
    assert all(reason for _, reason in allowed_skips(ALLOWED_SKIPS.read_text("utf-8")))


def test_counts_by_feature_and_by_area():
    outcomes = [
        outcome(features=("a/b",)),
        outcome(features=("a/b", "c/d"), result="failed"),
        outcome("tests/common/test_x.py::test_y", features=("e/f",), result="skipped"),
    ]
    assert feature_counts(outcomes) == {
        "a/b": {"passed": 1, "failed": 1},
        "c/d": {"failed": 1},
        "e/f": {"skipped": 1},
    }
    lines = summary(outcomes)
    assert any(line.split()[:5] == ["ch01", "vulkan", "1", "1", "0"] for line in lines)
    assert "3 features of the ledger have tests here, 0 of them pass." in lines[-1]


pytest_plugins = ["pytester"]


def test_what_was_not_run_has_not_passed():
    never = Outcome("tests/ch01/test_a.py::test_b[vulkan]", ("a/b",), False)
    assert feature_counts([never]) == {}
    lines = summary([never, outcome()])
    assert any(line.split()[:5] == ["ch01", "vulkan", "1", "0", "0"] for line in lines)
    assert "1 tests were not run" in lines[-2]


def run_inner(pytester, text: str, *options: str, table: str = "", files=None, **environment: str):
    """Run a small suite of its own under the report, with `table` as its table of truths and `files` beside it."""
    (pytester.path / "tests").mkdir()
    if table:
        (pytester.path / "tests" / "oracles.toml").write_text(table)
    pytester.makeconftest(
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
        "from tests.support.report import Report\n"
        "def pytest_addoption(parser):\n"
        "    for name in ('--long', '--record'): parser.addoption(name, action='store_true')\n"
        "def pytest_configure(config):\n"
        "    for mark in ('feature(slug)', 'long', 'runs_on(backend)'):\n"
        "        config.addinivalue_line('markers', mark)\n"
        "    config.pluginmanager.register(Report(config), 'strata-report')\n"
    )
    folder = pytester.path / "tests" / "area"
    folder.mkdir(parents=True)
    for name, content in {"test_inner.py": text, **(files or {})}.items():
        (folder / name).write_text(content)
    for name, value in environment.items():
        pytester._monkeypatch.setenv(name, value)
    return pytester.runpytest_subprocess("tests", "-p", "no:cacheprovider", *options)


SKIPPING = "import pytest\ndef test_a(): pass\ndef test_b(): pytest.skip('no such thing here')\n"


def test_a_skip_that_is_not_written_down_fails_in_ci_alone(pytester, tmp_path):
    done = run_inner(pytester, SKIPPING, CI="true", STRATA_CACHE=str(tmp_path))
    assert done.ret == 1
    done.stdout.fnmatch_lines(
        ["*test_b was skipped*which allowed_skips.txt does not allow*", "*1 passed, 1 skipped*"]
    )


WHOLE = {
    "importorskip": "pytest.importorskip('no_such_package_at_all', reason='no such thing here')",
    "skip": "pytest.skip('no such thing here', allow_module_level=True)",
}


@pytest.mark.parametrize("way", WHOLE)
def test_a_file_that_is_skipped_as_a_whole_fails_in_ci(pytester, tmp_path, way):
    beside = {"test_beside.py": "def test_c(): pass\n"} if way == "skip" else {}
    text = f"import pytest\n{WHOLE[way]}\ndef test_a(): pass\n"
    done = run_inner(pytester, text, files=beside, CI="true", STRATA_CACHE=str(tmp_path))
    assert done.ret == (1 if beside else 5), "5 is pytest's own, where no test was collected"
    done.stdout.fnmatch_lines(
        ["FAILED *test_inner.py was skipped as a whole*no such thing here*, which *.txt does not allow"]
    )


def test_a_file_that_is_skipped_as_a_whole_is_named_on_a_laptop(pytester, tmp_path):
    text, beside = f"import pytest\n{WHOLE['skip']}\n", {"test_beside.py": "def test_c(): pass\n"}
    done = run_inner(pytester, text, files=beside, CI="", STRATA_CACHE=str(tmp_path))
    assert done.ret == 0
    done.stdout.fnmatch_lines(["note: *test_inner.py was skipped as a whole*no such thing here*"])


def test_a_file_that_may_be_skipped_as_a_whole_is_written_down_as_its_tests_are():
    whole = outcome("tests/site/test_shown.py::", reason="Skipped: there is no Chromium")
    assert is_allowed(whole, [("tests/site/test_shown.py::*", "no Chromium")])
    assert not is_allowed(whole, [("tests/site/test_shown.py::test_a*", "no Chromium")])


TABLE = """
[kinds]
"closed form" = "A formula worked out on paper."
[features."a/b"]
oracle = "closed form"
held = "tests/area/test_inner.py::test_held"
negative = "tests/area/test_inner.py::test_negative"
backends = ["vulkan", "cpu"]
"""
PROVEN = """import pytest
pytestmark = pytest.mark.feature('a/b')
@pytest.mark.runs_on('vulkan')
@pytest.mark.parametrize('x', [1, 2])
def test_held(x): assert x == 1 or {held}
def test_negative(): {negative}
"""
SKIP = "pytest.skip('not here')"
LEFT_OUT = "def pytest_collection_modifyitems(items): del items[-1]\n"


@pytest.mark.parametrize(
    ("negative", "late", "code", "said"),
    [
        (SKIP, "", 0, "note: The negative case of 'a/b' is *::test_negative, which was only skipped."),
        ("pass", LEFT_OUT, 1, "FAILED The negative case of 'a/b' is *::test_negative, which was not run."),
    ],
)
def test_a_whole_run_is_held_to_the_table_of_truths(pytester, tmp_path, negative, late, code, said):
    """A skip is a note where it is not CI; a test that is not run at all fails everywhere."""
    text, files = PROVEN.format(held=SKIP, negative=negative), {"conftest.py": late}
    done = run_inner(pytester, text, table=TABLE, files=files, CI="", STRATA_CACHE=str(tmp_path))
    assert done.ret == code
    done.stdout.fnmatch_lines([said])
    done.stdout.no_fnmatch_line("*'a/b' is held by*")  # one of its two parameters has passed


def ran(test: str, result: str, *backends: str) -> Outcome:
    return outcome(f"tests/a/test_x.py::{test}[1]", result=result, backends=backends, features=("a/b",))


@pytest.mark.parametrize(
    ("backends", "more", "outcomes", "whole", "said"),
    [
        (["vulkan", "gl"], {}, [("without-all", "passed"), ("gl", "passed")], True, None),
        (["vulkan", "gl"], {}, [("vulkan", "passed"), ("cpu", "passed")], True, ("gl: none passed", False)),
        (["vulkan", "gl"], {}, [("vulkan", "passed"), ("cpu", "passed")], False, None),
        (["vulkan", "gl"], {}, [("vulkan", "passed"), ("gl", "skipped")], True, ("gl: its tests", True)),
        (
            ["vulkan", "gl"],
            {"record": "docs/x.json"},
            [("vulkan", "passed"), ("gl", "skipped")],
            True,
            None,
        ),
        (["gl"], {"record": "docs/x.json"}, [("cpu", "passed")], True, ("gl: none passed", False)),
    ],
)
def test_a_marked_test_must_have_passed_on_each_backend(backends, more, outcomes, whole, said):
    """In a whole run; what is skipped for want of a device needs the record of one that has it."""
    held = "tests/a/test_x.py::test_held"
    entry = {"oracle": "calls", "held": held, "negative": held, "backends": backends, **more}
    found = oracles.unproven(
        oracles.Table({}, {"a/b": entry}),
        [ran("test_held", "passed", "cpu"), *(ran("test_other", r, b) for b, r in outcomes)],
        whole,
    )
    assert [(one.sentence.partition("on ")[2][: len(said[0])], one.skipped) for one in found] == (
        [said] if said else []
    )


@pytest.mark.parametrize(
    ("results", "whole", "more", "said"),
    [
        (["passed"], True, {}, []),
        (["passed", "skipped"], True, {}, []),
        (["passed", "failed"], True, {}, [("failed", False)]),
        (["skipped", "failed"], False, {"record": "docs/x.json"}, [("failed", False)]),
        (["skipped"], True, {}, [("was only skipped", True)]),
        (["skipped"], False, {}, [("was only skipped", True)]),
        (["skipped"], True, {"record": "docs/x.json"}, []),
        ([], True, {}, [("was not run", False)]),
        ([], True, {"record": "docs/x.json"}, [("was not run", False)]),
        ([], False, {}, []),
        (["not run"], False, {}, []),
    ],
)
def test_a_test_of_the_table_must_have_passed_and_failed_with_no_parameter(results, whole, more, said):
    """Where only some tests were run, that holds for those."""
    entry = {"oracle": "calls", "held": "tests/a/test_x.py::test_held", **more}
    other = [ran("test_other", "failed", "cpu")]
    found = oracles.unproven(
        oracles.Table({}, {"a/b": entry}), [*other, *(ran("test_held", one, "cpu") for one in results)], whole
    )
    sentence = "'a/b' is held by tests/a/test_x.py::test_held, which {}."
    assert [(one.sentence, one.skipped) for one in found] == [(sentence.format(a), b) for a, b in said]


@pytest.mark.parametrize(
    ("result", "said"), [("skipped", []), ("failed", ["failed"]), ("passed", ["no excuse"])]
)
def test_what_the_table_says_is_not_shown_may_be_skipped_and_no_more(result, said):
    """And where it is shown, the table has to say so."""
    held = "tests/a/test_x.py::test_held"
    entry = {"oracle": "calls", "held": held, "negative": held, "backends": ["cpu"]}
    table = oracles.Table({}, {"a/b": entry}, unshown={"a/b": "No machine has such a device."})
    found = oracles.unproven(table, [ran("test_held", result, "cpu")], True)
    assert len(found) == (3 if said == ["failed"] else len(said))
    assert all(said[0] in one.sentence for one in found[:1]), found


def test_a_skip_is_no_failure_on_a_laptop(pytester, tmp_path):
    done = run_inner(pytester, SKIPPING, CI="", STRATA_CACHE=str(tmp_path))
    assert done.ret == 0
    done.stdout.fnmatch_lines(["area*passed*skipped*", "area*1*0*1*"])


def test_results_are_kept_for_list_features(pytester, tmp_path):
    text = "import pytest\n@pytest.mark.feature('a/b')\ndef test_a(): pass\n"
    assert run_inner(pytester, text, CI="", STRATA_CACHE=str(tmp_path)).ret == 0
    (area,) = results.read(tmp_path / "tests" / "results.json").values()
    assert area.features == {"a/b": {"cpu": {"passed": 1}}} and area.tests == {"cpu": {"passed": 1}}
    assert area.run.commit == report.commit() and area.run.devices["cpu"].startswith("Python")
    assert not (pytester.path / "docs").exists(), "that takes --record"


MIXED = """import pytest
@pytest.mark.feature('a/b')
def test_a(): pass
@pytest.mark.feature('a/b', 'c/d')
def test_b(): assert False
@pytest.mark.feature('c/d')
def test_c(): pytest.skip('no such thing here')
"""


@pytest.mark.feature("tools/site")
def test_a_run_with_a_failure_and_a_skip_is_recorded_in_ci_too(pytester, tmp_path):
    done = run_inner(pytester, MIXED, "--record", CI="true", STRATA_CACHE=str(tmp_path))
    assert done.ret == 1
    done.stdout.fnmatch_lines(["docs/records/tests.json has the results of area."])
    found = results.read(pytester.path / "docs" / "records" / "tests.json")["area"]
    assert found.tests == {"cpu": {"passed": 1, "failed": 1, "skipped": 1}}
    assert found.features == {
        "a/b": {"cpu": {"passed": 1, "failed": 1}},
        "c/d": {"cpu": {"failed": 1, "skipped": 1}},
    }


@pytest.mark.parametrize(
    ("option", "why"), [("-x", "the run ended before all its tests were run"), ("-kc", "-k leaves tests out")]
)
def test_what_was_run_in_part_is_not_recorded_and_that_is_said(pytester, tmp_path, option, why):
    done = run_inner(pytester, MIXED, "--record", option, CI="", STRATA_CACHE=str(tmp_path))
    done.stdout.fnmatch_lines(
        ["docs/records/tests.json has the results of no area.", f"It keeps what it had of area: {why}."]
    )
    assert results.read(pytester.path / "docs" / "records" / "tests.json") == {}
