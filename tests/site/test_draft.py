"""Links of the repository's texts as links of the site; what fails as a sentence; and the tables."""

from __future__ import annotations

import re

import pytest

import chapters
from bootstrap.plan import decide
from common.errors import UserError
from common.paths import ROOT
from tools.ledger.results import Area, Run
from tools.site import pairs as site_pairs
from tools.site import tables
from tools.site.draft import Draft
from tools.site.pairs import overlays


@pytest.mark.parametrize(
    ("path", "page", "text", "expected"),
    [
        ("README.md", "index.md", "[a](chapters/ch01/README.md#b)", "[a](chapters/ch01.md#b)"),
        ("chapters/ch01/README.md", "chapters/ch01.md", "[a](../ch02/README.md)", "[a](ch02.md)"),
        (
            "chapters/ch01/README.md",
            "chapters/ch01.md",
            "![a](../../docs/pictures/atrium.png)",
            "![a](../pictures/atrium.png)",
        ),
        (
            "chapters/ch01/README.md",
            "chapters/ch01.md",
            "[`s`](settings.py)",
            "[`s`](../source/chapters/ch01/settings.py.html)",
        ),
        ("README.md", "index.md", "[a](chapters/ch03/README.md)", "[a](source/chapters/ch03/README.md.html)"),
        ("README.md", "index.md", "[a](tests)", "[a](source/tests/index.html)"),
        ("README.md", "index.md", "[a](https://example.org) [b](#c)", "[a](https://example.org) [b](#c)"),
        (
            "README.md",
            "index.md",
            "```\n[a](README.md)\n```\n[a](LICENSE)",
            "```\n[a](README.md)\n```\n[a](source/LICENSE.html)",
        ),
    ],
)
def test_links_hold_on_the_site(path: str, page: str, text: str, expected: str) -> None:
    draft = Draft((1, 2))
    assert draft.localised(text, path, page) == expected
    assert draft.lacks == []


def test_files_that_are_linked_to_come_along() -> None:
    draft = Draft((1,))
    draft.localised(
        "![a](docs/pictures/atrium.png) [b](common/view/clock.py) [c](chapters/ch01/studies)",
        "README.md",
        "index.md",
    )
    assert draft.files["pictures/atrium.png"].startswith(b"\x89PNG")
    assert b'id="L1"' in draft.files["source/common/view/clock.py.html"]
    folder = draft.files["source/chapters/ch01/studies/index.html"].decode()
    assert (
        'href="phong/index.html"' in folder and "source/chapters/ch01/studies/phong/index.html" in draft.files
    )


def test_a_dead_link_is_named_with_its_page() -> None:
    draft = Draft()
    assert draft.localised("[a](nowhere.md)", "docs/site/index.md", "index.md") == "[a](nowhere.md)"
    assert draft.lacks == ["index.md: what it links to, docs/site/nowhere.md, is not in the repository."]


def test_what_fails_costs_a_sentence_and_not_the_site() -> None:
    draft = Draft()

    def broken() -> str:
        raise UserError("there is no device.\nAnd more.")

    shown = draft.attempt("a.md", "the graph", broken)
    assert draft.lacks == ["a.md: the graph, since there is no device."]
    assert shown == '<p class="lack">Not here: the graph, since there is no device.</p>'
    assert "<code>x &lt;y&gt;</code>" in draft.lack("a.md", "`x <y>`")


def test_pieces_are_put_where_a_page_asks_for_them(monkeypatch) -> None:
    monkeypatch.setitem(tables.PIECES, "long", lambda draft, page: f"table of {page}")
    text = "one\n\n<!-- strata: long -->\n\ntwo"
    assert tables.filled(Draft(), text, "a.md") == "one\n\ntable of a.md\n\ntwo"


def test_the_pages_of_the_site_ask_for_every_piece_and_for_no_other() -> None:
    texts = "".join(path.read_text("utf-8") for path in sorted((ROOT / "docs" / "site").glob("*.md")))
    assert {*re.findall(r"<!-- strata: (\w+) -->", texts)} == {*tables.PIECES}


def test_a_piece_that_nobody_makes_is_named_with_those_there_are() -> None:
    draft = Draft()
    tables.filled(draft, "<!-- strata: sped -->", "a.md")
    assert draft.lacks == [f"a.md: what it calls sped: there are {', '.join(tables.PIECES)}."]


def test_a_record_that_lacks_a_number_costs_its_place_alone(monkeypatch) -> None:
    pairs = site_pairs.pairs_of(1)
    known = site_pairs.read()
    broken = {**known, pairs[0].name: {**known[pairs[0].name], "verdict": None}}
    del broken[pairs[0].name]["verdict"]
    monkeypatch.setattr(site_pairs, "read", lambda: broken)
    draft = Draft((1,))
    shown = overlays(draft, 1, "chapters/ch01.md")
    assert draft.lacks == [f"chapters/ch01.md: {pairs[0].a} over {pairs[0].b}, since 'verdict' is missing."]
    assert shown.count('<figure class="overlay"') == len(pairs) - 1


def test_a_chapter_that_cannot_be_imported_costs_its_row_alone(monkeypatch) -> None:
    lesson = chapters.lesson

    def broken(which: int) -> object:
        if which == 1:
            raise SyntaxError("invalid syntax")
        return lesson(which)

    monkeypatch.setattr(chapters, "lesson", broken)
    monkeypatch.setattr(tables.results, "read", dict)
    draft = Draft()
    rows = tables.chapters_table(draft, "index.md").splitlines()
    assert draft.lacks[0] == "index.md: what chapter 1 says of itself, since invalid syntax."
    assert any(lesson(2).title in row for row in rows)


def test_without_records_each_table_says_which_command_makes_them(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(tables.results, "read", dict)
    monkeypatch.setattr(tables, "LONG", tmp_path / "long.json")
    monkeypatch.setattr(tables.pairs, "RECORD", tmp_path / "pairs.json")
    monkeypatch.setattr(tables, "records_of", lambda number: {})
    draft = Draft((1,))
    for name, make in tables.PIECES.items():
        assert make(draft, f"{name}.md") is not None
    said = "\n".join(draft.lacks)
    for command in (
        "./strata test --record",
        "./strata test --long",
        "docs/pictures.py",
        "./strata bench 1 --record",
    ):
        assert command in said


def test_the_table_of_chapters_counts_what_was_recorded(monkeypatch) -> None:
    held = {"a/b": {"vulkan": {"passed": 3}}, "c/d": {"vulkan": {"skipped": 1}, "cpu": {"failed": 1}}}
    run = Run("2026-01-02T03:04:05", "abc", {"vulkan": "a card", "cpu": "Python"})
    made = {"ch01": Area(run, {"vulkan": {"passed": 7, "skipped": 2}, "cpu": {"failed": 1}}, held)}
    monkeypatch.setattr(tables.results, "read", lambda: made)
    text = tables.chapters_table(Draft((1,)), "index.md")
    row = next(line for line in text.splitlines() if line.startswith("| 1 |"))
    cells = "7 passed, 2 skipped<br><small>1 features</small> | not run | not run | 1 failed |"
    assert row.endswith(cells)
    assert "Tests as they went on 2026-01-02, commit abc, on a card; Python." in text


@pytest.mark.parametrize("name", tables.SYSTEMS)
def test_the_setup_page_shows_what_the_launcher_would(name: str) -> None:
    page = tables.setup_commands(Draft(), "setup.md")
    commands = list(decide(tables.SYSTEMS[name], install=False).commands())
    part = page.split(f"### {name}\n", 1)[1].split("\n### ", 1)[0]
    assert commands and all(command in part for command in commands)
    notes = decide(tables.SYSTEMS[name], install=False).notes
    assert part.rstrip().endswith("".join(f"\n\n{note}" for note in notes))


def test_the_readme_s_table_says_which_chapters_run() -> None:
    rows = re.findall(
        r"^\| (\d+) \| (.*) \| (runs|to come) \|$", (ROOT / "README.md").read_text("utf-8"), re.M
    )
    assert [int(number) for number, _, _ in rows] == list(range(1, 16))
    for number, title, state in rows:
        there = int(number) in chapters.available()
        assert state == ("runs" if there else "to come")
        assert there == title.endswith(f"](chapters/ch{int(number):02}/README.md)")
