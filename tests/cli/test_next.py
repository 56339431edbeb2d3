"""`strata next`: the section that comes next, what ends a section, and where progress is kept."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
import typer

import chapters
from chapters import scenes, studies
from common import paths
from common.settings import knobs
from tools.cli.commands import app
from tools.lessons import progress, sections
from tools.lessons.next import current, is_done
from tools.lessons.progress import Progress

pytestmark = pytest.mark.feature("tools/exercises")


def test_a_new_reader_is_in_the_first_section(strata):
    code, out, err = strata("next")
    first = sections.all_parts()[0]
    assert code == 0 and out.startswith("Chapter 1: ")
    assert f"Section 1 of {first.count}: {first.section.title}, {first.section.minutes} minutes" in out
    for name in first.section.files:
        assert f"chapters/ch01/{name}\n" in out
    assert (
        f"./strata {first.section.run}\n" in out and f"./strata exercise {first.exercise} --into DIR" in out
    )
    assert sections.all_parts()[1].section.title in err
    assert not progress.file().exists()


def test_done_goes_to_the_next_section_and_a_number_to_a_chapter(strata):
    first, second = sections.all_parts()[:2]
    assert second.section.title in strata("next", "--done")[1]
    assert is_done(first, progress.load()) and not is_done(second, progress.load())
    assert strata("next", "4")[1].startswith("Chapter 4: ")
    assert strata("next")[1].startswith("Chapter 4: ")
    table = strata("next", "--all")[1]
    assert "you are here" in table and "Chapter 5: 0 of" in table
    assert strata("next", "--forget")[0] == 0
    assert strata("next")[1].startswith("Chapter 1: ")


def test_a_solved_exercise_ends_its_section(strata):
    part = sections.parts(2)[0]
    progress.add(solved=[f"2/{part.section.exercise}"], chapter=2)
    out = strata("next")[1]
    assert (
        sections.parts(2)[1].section.title in out
        and f"Solved in this chapter: 1 of 4 exercises ({part.section.exercise})." in out
    )


def test_after_the_last_section_earlier_open_ones_follow(strata):
    every = sections.all_parts()
    last = chapters.available()[-1]
    known = Progress(read=frozenset(part.key for part in sections.parts(last)), chapter=last)
    assert current(known) == every[0]
    progress.save(Progress(read=frozenset(part.key for part in every)))
    assert "all sections" in strata("next")[1]
    code, _, err = strata("next", "--done")
    assert code == 2 and "All sections are done" in err


@pytest.mark.parametrize("part", sections.all_parts(), ids=lambda part: part.key)
def test_the_command_of_a_section_is_one(part):
    """It parses; its scene, study and knobs exist."""
    name, *words = part.section.run.split()
    context = typer.main.get_command(app).commands[name].make_context(name, [*words])
    which = studies.parse(words[0]) if "/" in words[0] else chapters.parse_chapter(words[0])
    assert which == part.chapter or str(which).startswith(f"{part.chapter}/")
    if context.params.get("scene"):
        scenes.load(context.params["scene"], None, "none")
    settings = knobs(chapters.settings_class(which))
    for change in context.params.get("set_") or ():
        knob, _, value = change.partition("=")
        assert knob in settings and value in map(str, settings[knob].choices or [value]), change


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("next", "17"), "no chapter"),
        (("next", "2", "--done"), "One at a time"),
        (("next", "--forget", "--all"), "One at a time"),
        (("next", "1/first-triangle"), ""),
    ],
)
def test_wrong_words_are_refused_in_a_sentence(strata, words, said):
    code, _, err = strata(*words)
    assert code == 2 and said in err and "Traceback" not in err


@pytest.mark.parametrize(
    "text", ["", "{", "[]", json.dumps({"format": 9}), json.dumps({"format": 1, "solved": 3})]
)
def test_a_damaged_file_is_named_and_stays(strata, text):
    progress.file().parent.mkdir(parents=True, exist_ok=True)
    progress.file().write_text(text, "utf-8")
    code, _, err = strata("next")
    assert code == 2 and str(progress.file()) in err and "Traceback" not in err
    assert progress.file().read_text("utf-8") == text


def test_a_home_that_cannot_be_written_says_so(strata, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STRATA_STATE", str(tmp_path / "file" / "state"))
    code, _, err = strata("next", "--done")
    assert code == 2 and "cannot be written" in err
    assert strata("next", "--forget")[0] == 0, "nothing is kept there"


def test_what_cannot_be_deleted_is_named(strata):
    progress.file().mkdir(parents=True)
    code, _, err = strata("next", "--forget")
    assert code == 2 and f"{progress.file()} cannot be deleted" in err and "Traceback" not in err


def test_two_commands_at_once_lose_nothing(strata):
    """Each one adds a section; without the lock the later one writes what it read before the other had written."""
    names = [f"1/section {number}" for number in range(24)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: progress.add(read=[name]), names))
    assert progress.load().read == {*names}


def test_progress_is_not_in_the_cache(monkeypatch, tmp_path):
    """A cache may be deleted at any time; what the user has done cannot be made again."""
    monkeypatch.delenv("STRATA_STATE", raising=False)
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    assert tmp_path not in paths.user_state().parents and paths.user_state() != paths.user_cache()
    for system, name, value in (("linux", "XDG_STATE_HOME", "/a"), ("win32", "APPDATA", "/b")):
        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setenv(name, value)
        assert paths.user_state().as_posix() == f"{value}/strata"
