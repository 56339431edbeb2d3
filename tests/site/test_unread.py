"""A record that cannot be read costs its own place: the pages say which one it is, and why, and show the others."""

from __future__ import annotations

import json

import pytest

import chapters
from tools.bench import bench
from tools.site import chapter, records, tables
from tools.site.draft import Draft

GOOD = json.loads((bench.FOLDER / "ch01-software.json").read_text("utf-8"))
WRONG = {
    "cut short": (json.dumps(GOOD)[:5000], "it is no record of a bench: "),
    "empty": ("", "it is no record of a bench: "),
    "a list": ("[1, 2]", "it is no record of a bench: "),
    "another format": (json.dumps({**GOOD, "format": 1}), "it is a record of format 1, not 2: measure again"),
    "without points": (
        json.dumps({name: value for name, value in GOOD.items() if name != "points"}),
        "it has no points",
    ),
    "points that are none": (json.dumps({**GOOD, "points": {"a": 1}}), "its points are no list"),
    "no device": (
        json.dumps({**GOOD, "device": {"name": "a card"}}),
        "it does not say of which device it is",
    ),
}
"""What stands in the file beside a good record, and what is said of it."""


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder of records with that of chapter 1 on software alone, and no other chapter."""
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    monkeypatch.setattr(chapters, "available", lambda: (1,))
    (tmp_path / "ch01-software.json").write_text(json.dumps(GOOD), "utf-8")
    return tmp_path


def drafted(monkeypatch):
    """Return the pages that show records, as (page, text), and what they lack."""
    draft = Draft((1,))
    monkeypatch.setattr(draft, "file", lambda path, page: path)
    made = {
        "chapters/ch01.md": chapter._plots(draft, 1, "chapters/ch01.md"),
        "speed.md": tables.speed_table(draft, "speed.md"),
        "accuracy.md": tables.stability_table(draft, "accuracy.md"),
    }
    return made, draft.lacks


@pytest.mark.feature("tools/site")
@pytest.mark.parametrize("what", WRONG)
def test_every_page_says_which_record_it_cannot_show_and_why(folder, monkeypatch, what):
    alone, none = drafted(monkeypatch)
    assert none == []
    text, said = WRONG[what]
    (folder / "ch01-discrete.json").write_text(text, "utf-8")
    pages, lacks = drafted(monkeypatch)
    begin = f"what ch01-discrete.json measured, since {said}"
    assert [one.partition(": ")[0] for one in lacks] == [*pages]
    assert all(one.partition(": ")[2].startswith(begin) and one.endswith(".") for one in lacks), lacks
    assert not any(str(folder) in one for one in lacks), "no paths of this machine"
    for page, text in pages.items():
        assert f'<p class="lack">Not here: {begin}' in text
        assert GOOD["device"]["name"].partition(" (")[0] in text and alone[page].split("\n")[0] in text


def test_all_that_is_good_and_what_is_no_record_of_a_bench_is_not_complained_of(folder, monkeypatch):
    """What other programs have measured lies in the same folder; and a record may have other parts alone."""
    (folder / "ch01-both-software.json").write_text(json.dumps({"chapter": 1, "scenes": []}), "utf-8")
    (folder / "ch01-parts.json").write_text(json.dumps({**GOOD, "points": []}), "utf-8")
    (folder / "ch02-discrete.json").write_text("", "utf-8")
    assert [*records.records_of(1)] == ["ch01-software.json"]
    assert drafted(monkeypatch)[1] == [] == [*records.unreadable(1)]
    assert [*records.unreadable(2)] == ["ch02-discrete.json"]


def test_with_no_good_record_at_all_the_bad_one_is_named_too(folder, monkeypatch):
    (folder / "ch01-software.json").write_text("{", "utf-8")
    pages, lacks = drafted(monkeypatch)
    named = [one.partition(": ")[0] for one in lacks if "ch01-software.json" in one and "is no record" in one]
    assert named == [*pages]
    assert all("ch01-software.json" in text for text in pages.values())


def test_every_record_of_the_repository_is_read():
    assert {number: records.unreadable(number) for number in chapters.available()} == {
        number: {} for number in chapters.available()
    }
