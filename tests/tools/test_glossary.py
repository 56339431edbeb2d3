"""The glossary against the lessons: every term in bold has an entry, every entry its place, and nobody stands idle."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

import chapters
from common.errors import UserError
from common.paths import ROOT
from tools.ledger import glossary
from tools.ledger.glossary import Entry

ENTRIES = glossary.read()
LESSONS = {
    number: (ROOT / "chapters" / chapters.folder_name(number) / "README.md").read_text("utf-8")
    for number in chapters.available()
    if (ROOT / "chapters" / chapters.folder_name(number) / "README.md").is_file()
}


def place(text: str, start: int) -> str:
    return f"line {text.count(chr(10), 0, start) + 1}"


# --- the lessons ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", LESSONS)
def test_what_is_bold_in_a_lesson_is_in_the_glossary(number) -> None:
    known = glossary.by_form(ENTRIES.values())
    lost = [words for words in glossary.bold(LESSONS[number]) if glossary.normal(words) not in known]
    assert lost == [], "bold is for terms of docs/glossary.toml, and for leads, which end with . : or ?"


@pytest.mark.parametrize("number", LESSONS)
def test_a_lesson_shows_its_own_terms_in_bold_where_it_first_uses_them(number) -> None:
    """Once each, before any other use of the word in that README and in those before; none of another chapter's."""
    text = LESSONS[number]
    late, foreign, early, seen = [], [], [], set()
    for use in glossary.uses(text, ENTRIES.values()):
        name = use.entry.name
        if use.bold and (use.entry.chapter != number or name in seen):
            foreign.append(f"{name}, {place(text, use.start)}")
        if use.entry.chapter == number and name not in seen and not use.bold:
            late.append(f"{name}, {place(text, use.start)}")
        if use.entry.chapter > number:
            early.append(f"{name}, {place(text, use.start)}")
        seen.add(name)
    assert late == [], "used before it is bold"
    assert foreign == [], "bold here, and introduced by another chapter or a second time"
    assert early == [], "used before the chapter that introduces it"


def test_every_entry_is_introduced_by_its_chapter() -> None:
    bold = {
        number: {glossary.normal(words) for words in glossary.bold(text)} for number, text in LESSONS.items()
    }
    idle = [
        entry.name
        for entry in ENTRIES.values()
        if not {glossary.normal(form) for form in entry.forms} & bold.get(entry.chapter, set())
    ]
    assert idle == [], "entries that no README shows in bold"


# --- the file ---------------------------------------------------------------------------------------------------------


def test_entries_are_in_the_order_of_the_alphabet_and_none_is_twice() -> None:
    names = list(ENTRIES)
    assert names == sorted(names, key=str.casefold)
    owners: dict[str, str] = {}
    twice = []
    for entry in ENTRIES.values():
        for form in {glossary.normal(form) for form in entry.forms}:
            if owners.setdefault(form, entry.name) != entry.name:
                twice.append((form, owners[form], entry.name))
    assert twice == []
    anchors = [entry.anchor for entry in ENTRIES.values()]
    assert len(set(anchors)) == len(anchors) and all(anchors)


def test_entries_are_one_sentence_for_a_newcomer() -> None:
    """Short enough for a tooltip, and without signs that Markdown or the title of a link would take for its own."""
    faults = []
    for entry in ENTRIES.values():
        if not re.fullmatch(r"[A-Z][^\"|{}<>*`\[\]]+\.", entry.says) or re.search(r"\.\s", entry.says):
            faults.append(f"{entry.name}: is to be one plain sentence")
        if not 25 <= len(entry.says) <= 200:
            faults.append(f"{entry.name}: {len(entry.says)} signs")
        if entry.chapter not in chapters.available():
            faults.append(f"{entry.name}: there is no chapter {entry.chapter}")
        if normal_in(entry) and not entry.also:
            faults.append(f"{entry.name}: says itself")
    assert faults == []


def normal_in(entry: Entry) -> bool:
    """Whether a sentence explains a word by the word itself, as its first one."""
    return glossary.normal(entry.says).startswith(glossary.normal(entry.name) + " is")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[a\n", "is no TOML"),
        ('[""]\nsays = "A."\nchapter = 1\n', "an entry has no name"),
        ('["a"]\nsays = "x."\n', "chapter is missing"),
        ('["a"]\nsays = "x."\nchapter = 1\ncolour = 2\n', "colour cannot be 2"),
        ('["a"]\nsays = "x."\nchapter = "one"\n', "'a' is not as it should be: chapter cannot be 'one'"),
        ("a = 1\n", "'a' is not as it should be: says is missing"),
    ],
)
def test_a_glossary_that_is_wrong_is_one_sentence(tmp_path, text: str, said: str) -> None:
    file = tmp_path / "glossary.toml"
    file.write_text(text, "utf-8")
    with pytest.raises(UserError, match=said):
        glossary.read(file)
    with pytest.raises(UserError, match="cannot be read"):
        glossary.read(tmp_path / "none.toml")


# --- how texts are read -----------------------------------------------------------------------------------------------

BARRIER = Entry("barrier", "Says when.", 1, also=("pipeline barrier",))
POOL = Entry("command pool", "Holds.", 3)
PAGE = Entry("page", "A buffer.", 2, everyday=True)
BATCH = Entry("batch", "Together.", 2)
G = Entry("G-buffer", "Keeps.", 4)


def found(text: str, *entries: Entry) -> list[str]:
    return [
        text[use.start : use.end] for use in glossary.uses(text, entries or (BARRIER, POOL, PAGE, BATCH, G))
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a barrier, Barriers, and pipeline barriers", ["barrier", "Barriers", "pipeline barriers"]),
        ("**barrier**s and **barriers**", ["**barrier**", "**barriers**"]),
        ("command\npools, G-buffers; batches", ["command\npools", "G-buffers", "batches"]),
        ("a page of a **page**", ["**page**"]),
        (
            "`barrier`, `a\nbarrier`, [a barrier](b.md), ![barrier](c.png) and barrier-like <b class=barrier>",
            [],
        ),
        ("# A barrier\n\n```\nbarrier\n```\n\n**Barrier.** Then **no barrier:** it", []),
        ("## Further reading\n\n- *A barrier*\n\n## More\n\nbarrier", ["barrier"]),
        ("*a barrier* in **a pool** and 2 ** 3 barriers ** 2", ["barrier", "barriers"]),
    ],
)
def test_words_are_found_in_prose_alone(text: str, expected: list[str]) -> None:
    assert found(text) == expected


def test_what_is_bold_and_no_lead_is_a_term() -> None:
    text = "**Lead.** a **term**, **Try it:** **two\nwords** `**code**` **really?**\n- **item**: says\n"
    assert glossary.bold(text) == ["term", "two words", "item"]


def test_a_text_introduces_a_word_where_it_is_bold_else_where_it_is_first() -> None:
    text = "a barrier, a command pool, a **barrier** and a command pool"
    assert [(use.start, use.bold) for use in glossary.first_uses(text, (BARRIER, POOL))] == [
        (text.index("command"), False),
        (text.index("**"), True),
    ]


def test_a_glossary_without_words_finds_none() -> None:
    assert glossary.uses("Some **word**.", []) == []


def test_longer_names_win() -> None:
    entries = (Entry("depth", "", 1), Entry("depth of field", "", 4))
    assert found("depth of field, and depth", *entries) == ["depth of field", "depth"]


def test_forms_and_anchors() -> None:
    assert replace(BATCH, also=("memory", "box", "lux")).forms == (
        *("batch", "memory", "box", "lux"),
        *("batches", "memories", "boxes", "luxes"),
    )
    assert [Entry(name, "", 1).anchor for name in ("G-buffer", "Bayer's order", "dB")] == [
        *("g-buffer", "bayers-order", "db"),
    ]
    assert glossary.normal(" Depth_pre-pass\n x") == "depth pre pass x"
