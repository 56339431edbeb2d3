"""`strata explain`: what a word means, which tests hold a feature, what a setting does; near names; pipes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import chapters
from chapters import studies
from common.paths import ROOT
from common.settings import knob, knobs, preset
from tools.ledger import explain, features, glossary, results
from tools.ledger.glossary import normal


def one_line(text: str) -> str:
    return " ".join(text.split())


# --- terms ------------------------------------------------------------------------------------------------------------


def test_a_term_is_told_with_its_unit_and_the_line_that_introduces_it(strata) -> None:
    code, shown, said = strata("explain", "irradiance")
    entry = glossary.read()["irradiance"]
    assert (code, said) == (0, "")
    assert one_line(shown).startswith(f"irradiance, a term of chapter 1 {entry.says} Unit: {entry.unit}.")
    path, number = re.search(r"(chapters/ch01/README\.md):(\d+)$", shown, re.MULTILINE).groups()
    assert "**irradiance**" in (ROOT / path).read_text("utf-8").splitlines()[int(number) - 1]


def test_a_word_of_a_term_finds_the_term(strata) -> None:
    """ "timeline" is an area of features; a reader means the semaphore. A term of this name comes alone."""
    shown = strata("explain", "timeline")[1]
    assert "timeline, an area of" in shown and "timeline semaphore, a term of chapter 5" in shown
    assert "binary semaphore" not in strata("explain", "semaphore")[1]


@pytest.mark.parametrize("word", ["Vector-Clock", "vector clocks", "VECTOR_CLOCK", "  vector   clock "])
def test_a_name_may_be_written_in_any_way(strata, word: str) -> None:
    code, shown, _ = strata("explain", word)
    assert code == 0 and shown.startswith("vector clock, a term of chapter 5\n")
    assert strata("explain", *word.split())[1] == shown


def test_every_term_is_told() -> None:
    things = {thing.name: thing for thing in explain.everything() if thing.kind == "term"}
    assert list(things) == list(glossary.read())
    for entry in glossary.read().values():
        assert {normal(form) for form in entry.forms} == things[entry.name].keys


# --- features ---------------------------------------------------------------------------------------------------------


def test_a_feature_is_told_with_its_chapter_and_the_tests_that_hold_it(strata) -> None:
    code, shown, _ = strata("explain", "frame-graph/topological-sort")
    assert code == 0 and "\n  In chapter 4.\n  " in shown and "\n  tests/ch04/test_frame_graph.py\n" in shown
    assert "\n    test_the_order_is_valid_for_20_000_random_graphs\n" in shown
    assert shown in strata("explain", "Topological sort")[1]


def test_studies_that_show_a_feature_are_named(strata) -> None:
    (slug, *_) = studies.study("5/timeline-or-fences").features
    code, shown, _ = strata("explain", slug)
    assert code == 0 and "study 5/timeline-or-fences" in shown


def test_a_feature_tells_its_results_its_title_and_its_tests(capsys, monkeypatch, tmp_path) -> None:
    file = tmp_path / "tests" / "test_a.py"
    file.parent.mkdir()
    file.write_text('def test_one():\n    """It holds. And\n    more."""\n\ndef test_two(): pass\n', "utf-8")
    monkeypatch.setattr(explain, "ROOT", tmp_path)
    run = results.Run("2026-01-02", "abc", {})
    area = results.Area(run, {}, {"a/b": {"vulkan": {"passed": 2}, "gl": {"passed": 1, "skipped": 1}}})
    monkeypatch.setattr(results, "newest", lambda *_: {"ch03": area})
    tests = tuple(
        features.MarkedTest(f"tests/test_a.py::{name}", "ch03") for name in ("test_one", "test_two")
    )
    explain.show_feature(features.Feature("a/b", tests, (3,), features.Row("Some thing", "ch03", ())))
    assert capsys.readouterr().out.splitlines() == [
        "a/b, a feature that 2 tests hold",
        "  Some thing.",
        "  In chapter 3.",
        "  Last results: Vulkan: 2 passed; OpenGL: 1 passed, 1 skipped.",
        "  tests/test_a.py",
        "    test_one",
        "      It holds.",
        "    test_two",
    ]
    explain.show_feature(features.Feature("a/c", (), ()))
    assert "a feature that no test holds yet" in capsys.readouterr().out


def test_every_feature_is_found_by_its_name_and_by_its_own_part() -> None:
    """The quick look that spares a search of all tests must miss none."""
    things = [thing for thing in explain.everything() if thing.kind in ("feature", "area")]
    tested = {*features.marked_tests()} | {slug.partition("/")[0] for slug in features.marked_tests()}
    assert len(tested) > 150
    texts = "\n".join(path.read_text("utf-8") for path in features.TESTS.rglob("test_*.py"))
    assert {thing.name for thing in things} >= tested
    for name in sorted(tested):
        part = name.rpartition("/")[2]
        assert f'/{part}"' in texts or f'"{part}/' in texts, name
    assert explain.may_be_a_feature("topological sort") and explain.may_be_a_feature("frame graph/edges")
    assert explain.may_be_a_feature("frame graph") and not explain.may_be_a_feature("no such thing at all")


def test_an_area_tells_its_features(strata) -> None:
    shown = one_line(strata("explain", "frame-graph")[1])
    assert "frame graph, a term of chapter 4" in shown and "a frame graph, what chapter 4 adds" in shown
    for slug in features.marked_tests():
        assert (f"{slug}," in f"{shown}," or f"{slug} " in shown) == slug.startswith("frame-graph/")


# --- settings ---------------------------------------------------------------------------------------------------------


def test_a_setting_is_told_with_values_default_presets_and_who_has_it(strata) -> None:
    shown = one_line(strata("explain", "mask-coverage")[1])
    record = knobs(chapters.settings_class(5))["mask_coverage"]
    last = chapters.available()[-1]
    assert shown.startswith(f"mask_coverage, a setting of chapters 1 to {last}")
    assert f"Values: {record.range_text()}. Default: {explain.text_of(record.default)}." in shown
    assert f"./strata run {last} --set mask_coverage=" in shown
    shown = one_line(strata("explain", "msaa")[1])
    kind = chapters.settings_class(last)
    values = [f"{name} {preset(kind, name).shading.msaa}" for name in kind.PRESETS]
    assert f"Presets of chapter {last}: {', '.join(values)}." in shown


def test_every_setting_of_every_chapter_and_study_is_known() -> None:
    found = explain.settings()
    for number in chapters.available():
        for name in knobs(chapters.settings_class(number)):
            assert str(number) in found[name]
    assert "5/torus-knot" in found["morph"]


def test_a_word_of_several_meanings_shows_all(strata) -> None:
    """A term by its other name, a chapter's setting, and a setting that studies understand otherwise."""
    _, shown, _ = strata("explain", "anisotropy")
    assert [
        line.split(",")[0]
        for line in shown.splitlines()
        if "," in line and line[0].isalpha()  # a line that goes on begins with a study, or is indented
    ] == [
        "anisotropic filtering",
        *["anisotropy"] * 3,  # of textures, and of the phase function in two studies
    ]
    _, shown, _ = strata("explain", "sky")
    assert shown.count("sky, a setting of ") == 4 and "a setting of study 1/burley-smith" in shown


def test_what_differs_between_chapters_is_told_apart(capsys) -> None:
    alike, other = knob(1, "How many").metadata["knob"], knob(2, "How many").metadata["knob"]
    owners = {"1": alike, "2": alike, "4": other, "5": other, "5/torus-knot": alike}
    explain.show_setting("msaa", owners)
    shown = one_line(capsys.readouterr().out)
    for whose, default in (("chapters 1 to 2; study 5/torus-knot", 1), ("chapters 4 to 5", 2)):
        assert f"msaa, a setting of {whose} How many. Values: any number. Default: {default}." in shown


@pytest.mark.parametrize(
    ("owners", "said"),
    [
        (["1"], "chapter 1"),
        (["1", "2", "3", "5"], "chapters 1 to 3, 5"),
        (["2/a", "3/b"], "studies 2/a, 3/b"),
        (["4", "1/a"], "chapter 4; study 1/a"),
    ],
)
def test_owners_in_words(owners: list[str], said: str) -> None:
    assert explain.in_words(owners) == said


def test_environment_variables_are_those_that_the_program_reads(strata) -> None:
    """All of them, and no others; those of tests are the tests' own."""
    read = set()
    for folder in ("common", "backends", "chapters", "tools", "bootstrap"):
        for path in (ROOT / folder).rglob("*.py"):
            read.update(re.findall(r"environ(?:\.get\(|\[)\"(STRATA_\w+)\"", path.read_text("utf-8")))
    assert read == {*explain.VARIABLES}
    assert strata("explain", "STRATA_CACHE")[1].startswith("STRATA_CACHE, an environment variable\n")


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "near"),
    [
        ("bariers", "'barrier'"),
        ("taps", "'bokeh_taps'"),
        ("cloth_stepp", "'cloth_step'"),
    ],
)
def test_near_names_are_suggested(strata, word: str, near: str) -> None:
    code, shown, said = strata("explain", word)
    assert (code, shown) == (2, "") and said.startswith(
        f"strata: Nothing here is called {word!r}; did you mean "
    )
    assert near in said and said.endswith("?\n")


@pytest.mark.parametrize("word", ["qqqqqq", "☃", "a" * 500, "../..", "%s {0} [bold]"])
def test_a_word_like_none_is_one_sentence(strata, word: str) -> None:
    code, shown, said = strata("explain", word)
    assert (code, shown) == (2, "")
    assert one_line(said) == f"strata: Nothing here is called {word!r}: ./strata explain lists what there is."


def test_an_empty_word_is_one_sentence(strata) -> None:
    assert strata("explain", " ")[::2] == (2, "strata: Explain what? ./strata explain lists what there is.\n")


def test_without_a_word_all_names_are_shown(strata) -> None:
    code, shown, said = strata("explain")
    listed = one_line(shown)
    assert (code, said) == (0, "")
    for thing in explain.everything():
        assert thing.kind == "feature" or re.search(rf"(?<!\w){re.escape(thing.name)}(?!\w)", listed), thing


def test_narrow_and_piped_no_line_is_longer_than_the_terminal_but_for_names(strata, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    for word in ("irradiance", "cloth_execution", "frame-graph", "descriptor set"):
        for text in strata("explain", word)[1].splitlines():
            assert len(text) <= 60 and text == text.rstrip() and "\x1b" not in text


def test_from_another_folder_and_into_a_file(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "40"}
    command = [sys.executable, "-P", "-m", "chapters", "explain", "NaN"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.startswith("NaN, a term of chapter 4\n") and done.stderr == ""
