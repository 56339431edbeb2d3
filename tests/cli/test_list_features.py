"""`strata list --features`: rows, tests and states by backend, from marks and records, with and without the ledger."""

from __future__ import annotations

import json

import pytest

from tools.ledger import features, list_features, results
from tools.ledger.features import Feature, MarkedTest, Row
from tools.ledger.results import Area, Run

OLD = Run("2026-01-02T03:04:05+00:00", "abc", {"vulkan": "a card", "gl": "a card by OpenGL"})
NEW = Run("2026-02-02T03:04:05+00:00", "def", {"vulkan": "another card"})
HEAD = "slug\thome\tbackends\tsource\ttitle\tacceptance\n"


@pytest.fixture(autouse=True)
def project(monkeypatch, tmp_path) -> None:
    """Four features with tests, a record of two areas, a newer result of one of them, and no ledger."""
    held = {
        "barriers/derived": (MarkedTest("tests/ch01/test_x.py::test_none_is_missing", "ch01"),),
        "cli/alone": (MarkedTest("tests/cli/test_y.py::test_z", "cli"),),
        "late/never": (MarkedTest("tests/tools/test_w.py::test_v", "tools"),),
        "late/partly": (
            MarkedTest("tests/cli/test_y.py::test_u", "cli"),
            MarkedTest("tests/tools/test_w.py::test_u", "tools"),
        ),
    }
    monkeypatch.setattr(features, "marked_tests", lambda: held)
    monkeypatch.setattr(features, "_studied", dict)
    monkeypatch.setenv("STRATA_FEATURES", str(tmp_path / "none.tsv"))
    first = {"vulkan": {"passed": 3, "skipped": 1}, "gl": {"skipped": 2}}
    record = {
        "ch01": Area(OLD, first, {"barriers/derived": first}),
        "cli": Area(OLD, {}, {"cli/alone": {"cpu": {"passed": 1}}}),
    }
    held_now = {"cli/alone": {"cpu": {"passed": 1, "failed": 2}}, "late/partly": {"cpu": {"passed": 1}}}
    newer = {"cli": Area(NEW, {}, held_now)}
    own = results.own_path()
    monkeypatch.setattr(results, "read", lambda path=None: newer if path == own else record)


def row(printed: str, slug: str) -> list[str]:
    return next(line for line in printed.splitlines() if slug in line).split()


def test_each_row_has_its_tests_and_a_state_for_each_backend(strata) -> None:
    code, printed, _ = strata("list", "--features")
    assert code == 0
    assert row(printed, "barriers/derived") == ["barriers/derived", "1", "passed", "-", "skipped", "-"]
    assert row(printed, "cli/alone") == ["cli/alone", "1", "-", "-", "-", "failed"], "the newer result"
    assert row(printed, "late/never") == ["late/never", "1", *["not", "run"] * 4]
    assert row(printed, "late/partly") == ["late/partly", "2", *["not", "run"] * 3, "passed"]
    assert "Results of 2026-02-02 03:04 UTC, commit def: cli.\n  another card." in printed
    assert "Results of 2026-01-02 03:04 UTC, commit abc: ch01.\n  a card; a card by OpenGL." in printed
    assert "Never run: tools. ./strata test tools does it." in printed


def test_rows_are_chosen_by_chapter_and_by_words(strata) -> None:
    _, printed, _ = strata("list", "1", "--features")
    assert "barriers/derived" in printed and "cli/alone" not in printed
    _, printed, _ = strata("list", "--features", "--find", "NONE missing", "--tests")
    assert "tests/ch01/test_x.py::test_none_is_missing" in printed and "cli" not in printed
    assert "Vulkan: 3 passed, 1 skipped" in printed and "OpenGL: 2 skipped" in printed
    code, _, said = strata("list", "1", "--features", "--find", "alone")
    assert code == 2 and "No feature of chapter 1 has 'alone'" in said


def test_json_has_tests_states_counts_and_the_runs(strata) -> None:
    code, printed, _ = strata("list", "--features", "--json")
    found = json.loads(printed)
    first, second, third, _ = found["features"]
    assert {*found} == {"backends", "features", "runs"}
    assert found["backends"]["gl"] == "OpenGL"
    assert first.keys() == {"feature", "chapters", "tests", "state", "counts", "areas"}
    assert code == 0 and first["tests"] == ["tests/ch01/test_x.py::test_none_is_missing"]
    assert first["state"] == {"vulkan": "passed", "without-all": None, "gl": "skipped", "cpu": None}
    assert first["counts"]["vulkan"] == {"passed": 3, "skipped": 1}
    assert second["areas"] == {"cli": {"run": NEW.when, "cpu": {"passed": 1, "failed": 2}}}
    assert third["state"]["gl"] == "not run" and third["areas"] == {}
    assert found["runs"][NEW.when] == {"commit": "def", "devices": {"vulkan": "another card"}, "long": False}


def test_where_the_ledger_is_titles_are_shown_and_rows_without_a_test(strata, tmp_path) -> None:
    (tmp_path / "none.tsv").write_text(
        f'{HEAD}cli/alone\ttools\tvk+cpu\ta\tAlone "there"\tb\nx/untested\tcommon\tcpu\ta\tNo test\tb\n'
        "y/to-come\tch99\tvk\ta\tLater\tb\n",
        "utf-8",
    )
    _, printed, _ = strata("list", "--features")
    assert row(printed, "cli/alone")[2:] == ["no", "test", "-", "-", "failed"], "the ledger wants Vulkan"
    assert row(printed, "x/untested") == ["x/untested", "0", "-", "-", "-", "no", "test"]
    assert "to-come" not in printed and "1 more belong to chapters that are still to come." in printed
    _, printed, _ = strata("list", "--features", "--tests", "--find", "there")
    assert 'Alone "there"' in printed
    found = json.loads(strata("list", "--features", "--json", "--find", "there")[1])["features"][0]
    assert (found["title"], found["home"], found["wanted_on"]) == (
        'Alone "there"',
        "tools",
        ["vulkan", "cpu"],
    )


def test_options_of_features_ask_for_them(strata) -> None:
    for words in (("--find", "a"), ("--tests",), ("--json",)):
        code, _, said = strata("list", *words)
        assert code == 2 and f"./strata list --features {words[0]}" in said


def test_lines_of_a_feature_put_backends_of_one_result_together() -> None:
    one = Feature(
        "a/b", (MarkedTest("tests/cli/test_y.py::test_z", "cli"),), (), Row("Title", "tools", ("cpu",))
    )
    assert list_features._lines(one, {}) == [
        "Title",
        "Vulkan, Vulkan without options, OpenGL, CPU: not run",
        "tests/cli/test_y.py::test_z",
    ]


def test_marks_are_read_wherever_they_stand(tmp_path) -> None:
    text = (
        "import pytest\nfeature = pytest.mark.feature\nBOTH = feature('a/b', 'c/d')\n"
        "pytestmark = [pytest.mark.long, feature('e/f')]\n"
        "@BOTH\ndef test_a(): pass\n@pytest.mark.feature('g/h')\n@pytest.mark.parametrize('x', [1])\n"
        "def test_b(x): pass\nTEXT = \"@pytest.mark.feature('no/no')\"\nclass TestC:\n    def test_d(self): pass\n"
    )
    path = tmp_path / "test_x.py"
    path.write_text(text, "utf-8")
    names = {"test_a": ("a/b", "c/d", "e/f"), "test_b": ("g/h", "e/f"), "test_d": ("e/f",)}
    assert features.marked(path) == names
    path.write_text(text + "def (", "utf-8")
    assert features.marked(path) == {}
