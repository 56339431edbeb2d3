"""What a run of tests leaves for the site: whole areas alone, in few lines, and the others stay as they were."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

import chapters
from tests.support.records import areas_of, backends_of, whole_areas, why_partial
from tools.ledger import features, results
from tools.ledger.features import MarkedTest, OutOfDate
from tools.ledger.results import Area, Run

RUN = Run("2026-01-02T03:04:05+00:00", "abc", {"vulkan": "a card", "cpu": "Python"})
LATER = Run("2026-02-02T03:04:05+00:00", "def", {"gl": "another card"})


def outcome(area: str, backend: str, result: str, *slugs: str) -> SimpleNamespace:
    return SimpleNamespace(area=area, backends=tuple(backend.split()), result=result, features=slugs)


def area(run: Run = RUN, **slugs: str) -> Area:
    """Return an area with tests that passed, and of some features what became of one test on Vulkan."""
    held = {name.replace("_", "/"): {"vulkan": {result: 1}} for name, result in slugs.items()}
    return Area(run, {"vulkan": {"passed": 1}}, held)


def test_results_are_counted_by_area_backend_and_feature() -> None:
    outcomes = [
        outcome("ch01", "vulkan", "passed", "a/b", "c/d"),
        outcome("ch01", "vulkan", "failed", "a/b"),
        outcome("ch01", "gl", "skipped"),
        outcome("ch01", "without-all gl", "passed", "c/d"),
        outcome("cli", "cpu", "passed"),
    ]
    both = {"vulkan": {"passed": 1}, "without-all": {"passed": 1}, "gl": {"passed": 1}}
    held = {"a/b": {"vulkan": {"passed": 1, "failed": 1}}, "c/d": both}
    found = areas_of(outcomes, {}, {"ch01"}, RUN)
    tests = {"vulkan": {"passed": 1, "failed": 1}, "gl": {"skipped": 1}, "without-all": {"passed": 1}}
    assert found == {"ch01": Area(RUN, tests, held)}, "a test of both backends is one test"


def test_an_area_that_was_stopped_is_left_out() -> None:
    outcomes = [
        outcome("ch01", "gl", "passed"),
        outcome("ch01", "gl", "not run"),
        outcome("cli", "cpu", "passed"),
    ]
    assert [*areas_of(outcomes, {}, {"ch01", "cli"}, RUN)] == ["cli"]


def test_files_that_are_skipped_at_their_import_skip_the_features_of_all_their_tests() -> None:
    test = features.marked_tests()["tools/site"][0]
    found = areas_of([], {test.name.partition("::")[0]: "no such package"}, {test.area}, RUN)[test.area]
    assert found.tests == {"cpu": {"skipped": 1}} and found.features["tools/site"]["cpu"]["skipped"] >= 1


EVERY = ["tests/ch01/test_a.py", "tests/ch01/deep/test_b.py", "tests/stability/test_ch01.py"]
EVERY += ["tests/ch02/test_c.py", "tests/cli/test_d.py", "tests/cli/test_e.py", "tests/test_alone.py"]


@pytest.mark.parametrize(
    ("files", "subjects", "whole", "part"),
    [
        (EVERY, {"ch01", "ch02"}, {"alone", "ch01", "ch02", "cli"}, set()),
        (EVERY[:3], {"ch01"}, {"ch01"}, set()),
        (EVERY[:2], {"ch01"}, set(), {"ch01"}),
        (EVERY[:4], {"ch02"}, {"ch02"}, set()),
        (EVERY[3:4], {"ch01", "ch02"}, set(), {"ch02"}),
        (EVERY[4:5], {"ch01", "ch02"}, set(), {"cli"}),
    ],
    ids=["all", "a chapter", "not all its files", "a later one", "without those before", "a file"],
)
def test_an_area_is_whole_with_all_its_files_and_a_chapter_with_those_before_it(
    files, subjects, whole, part
) -> None:
    found = whole_areas(files, subjects, EVERY)
    assert {name for name, why in found.items() if not why} == whole
    assert {name for name, why in found.items() if why} == part


@pytest.mark.parametrize(
    ("option", "args", "said"),
    [
        ({"keyword": "alpha"}, [], "-k leaves tests out"),
        ({"markexpr": "not long"}, [], "-m leaves tests out"),
        ({"lf": True}, [], "--lf leaves tests out"),
        (
            {},
            ["tests/cli", "tests/cli/test_run.py::test_x"],
            "tests/cli/test_run.py::test_x leaves tests out",
        ),
        ({}, ["tests/cli"], ""),
    ],
)
def test_options_that_leave_tests_out_are_named(option, args, said) -> None:
    assert why_partial(SimpleNamespace(option=SimpleNamespace(**option), args=args)) == said


def test_the_backends_are_those_of_the_parameters_the_fixtures_and_the_mark(request) -> None:
    def item(*fixtures: str, marks: tuple[str, ...] = (), **parameters: object) -> SimpleNamespace:
        return SimpleNamespace(
            fixturenames=fixtures,
            callspec=SimpleNamespace(params=parameters),
            iter_markers=lambda name: [SimpleNamespace(args=marks)] if name == "runs_on" and marks else [],
        )

    assert backends_of(request.node) == ("cpu",)
    assert backends_of(item("gl_context", variant="gl")) == ("gl",)
    fixtures = ("chapter", "vulkan_instance")
    assert backends_of(item(*fixtures, variant="without-all", size=[1, 2])) == ("without-all",)
    assert backends_of(item("chapter", variant="deferred")) == ("vulkan",)
    assert backends_of(item("strata", "vulkan_instance")) == ("vulkan",)
    both = ("vulkan_device", "vulkan_instance", "gl_context")
    assert backends_of(item(*both)) == ("vulkan", "gl")
    assert backends_of(item(*both, variant="without-all")) == ("without-all", "gl")
    assert backends_of(item(marks=("vulkan", "gl"))) == ("vulkan", "gl"), "in a process of its own"


# --- the file ---------------------------------------------------------------------------------------------------------


def test_what_is_kept_is_read_again_and_areas_of_other_runs_stay(tmp_path) -> None:
    path = tmp_path / "records" / "tests.json"
    results.keep({"cli": area(), "old": area()}, {"cli", "old"}, path)
    results.keep({"ch01": area(LATER, a_b="failed"), "cli": area(LATER)}, {"cli", "ch01"}, path)
    assert results.read(path) == {"ch01": area(LATER, a_b="failed"), "cli": area(LATER)}, (
        "old is no area any more"
    )
    assert [*json.loads(path.read_text("utf-8"))["runs"]] == [LATER.when], "nobody refers to the other run"


def test_a_record_is_sorted_and_has_a_line_for_each_run_area_and_feature() -> None:
    made = {"cli": area(LATER), "ch01": area(c_d="passed", a_b="passed")}
    lines = [line.strip() for line in results.text(made).splitlines()]
    begins = [line.partition(": ")[0] for line in lines if line.startswith('"')]
    assert begins == [f'"{RUN.when}"', f'"{LATER.when}"', '"ch01"', '"a/b"', '"c/d"', '"cli"']
    assert results.text(dict(reversed(made.items()))) == results.text(made)


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"format": 99}', '{"format": 1, "runs": {}, "areas": {"a": {}}}']
)
def test_a_record_that_cannot_be_read_is_none(tmp_path, text: str) -> None:
    (tmp_path / "a.json").write_text(text, "utf-8")
    assert results.read(tmp_path / "a.json") == {} == results.read(tmp_path / "none.json")


def test_of_two_records_each_area_has_the_newer_result() -> None:
    assert results.newest({"a": area(LATER), "b": area()}, {"a": area(), "c": area()}) == {
        "a": area(LATER),
        "b": area(),
        "c": area(),
    }


# --- when it is out of date -------------------------------------------------------------------------------------------


@pytest.fixture
def two(monkeypatch) -> None:
    """A project with two features, of which tests of two areas hold one each, and one chapter."""
    held = {
        "a/b": (MarkedTest("tests/cli/test_x.py::test_y", "cli"),),
        "c/d": (MarkedTest("tests/ch01/test_x.py::test_z", "ch01"),),
    }
    monkeypatch.setattr(features, "marked_tests", lambda: held)
    monkeypatch.setattr(chapters, "available", lambda: (1,))


@pytest.mark.usefixtures("two")
def test_a_record_is_out_of_date_where_its_tables_have_gaps_and_not_with_each_commit() -> None:
    whole = {"cli": area(a_b="passed"), "ch01": area(c_d="failed")}
    assert features.out_of_date(whole) == OutOfDate(), "whatever commit it is of, and whatever failed"
    assert features.out_of_date({}) == OutOfDate(("ch01", "cli"), (), (), ("ch01", "cli"))
    assert features.out_of_date({**whole, "cli": area()}) == OutOfDate((), ("a/b",), (), ("cli",))
    gone = {**whole, "cli": area(a_b="passed", e_f="passed")}
    assert features.out_of_date(gone) == OutOfDate((), (), ("e/f",), ("cli",))
    (said,) = features.out_of_date(gone).sentences()
    assert said == "results for what no test names any more: e/f: `./strata test cli --record` keeps them."


@pytest.mark.usefixtures("two")
def test_what_the_run_itself_records_is_not_missed() -> None:
    assert features.out_of_date({}, soon={"cli", "ch01"}) == OutOfDate()
    assert features.out_of_date({}, soon={"cli"}).areas == ("ch01",)


@pytest.mark.feature("tools/site")
def test_the_record_of_tests_has_every_chapter_and_every_feature(request) -> None:
    """With `--record` the areas of this run count as recorded: they are, when it ends."""
    run = request.config.pluginmanager.getplugin("strata-report").whole_areas()
    soon = [area for area, why in run.items() if not why] if request.config.getoption("--record") else []
    late = features.out_of_date(results.read(), soon)
    assert late.sentences() == []
