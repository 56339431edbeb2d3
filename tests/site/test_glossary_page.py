"""The glossary on the site: terms lead there, it leads back, and texts are otherwise as they were."""

from __future__ import annotations

import re

import pytest

import chapters
from common.errors import UserError
from common.paths import ROOT
from tools.ledger import glossary
from tools.ledger.glossary import Entry
from tools.site import glossary as site_glossary
from tools.site.draft import Draft

LINK = re.compile(r'\[([^\[\]]+)\]\((?:\.\./)?glossary\.md#([\w-]+) "([^"]*)"\)\{ \.term( #[\w-]+)? \}')


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> dict[str, Entry]:
    """A glossary of three words."""
    made = {
        "barrier": Entry("barrier", "Lets work wait.", 1),
        "page": Entry("page", "A buffer.", 2, unit="MiB", everyday=True),
        "work group": Entry("work group", "Runs together.", 5, also=("group of invocations",)),
    }
    monkeypatch.setattr(glossary, "read", lambda: made)
    return made


def test_the_first_use_of_a_term_leads_to_the_glossary_and_others_do_not(known) -> None:
    text = "A page.\n\n## barrier\n\nThe barriers wait: a barrier, a work\ngroup and `barrier`; a **page**."
    assert site_glossary.linked(Draft(), text, "chapters/ch02.md") == (
        'A page.\n\n## barrier\n\nThe [barriers](../glossary.md#barrier "Lets work wait."){ .term } wait: '
        'a barrier, a [work\ngroup](../glossary.md#work-group "Runs together."){ .term } and `barrier`; '
        'a [**page**](../glossary.md#page "A buffer."){ .term #term-page }.'
    )


def test_a_link_from_the_top_of_the_site_goes_no_folder_up(known) -> None:
    assert "](glossary.md#barrier " in site_glossary.linked(Draft(), "barrier", "index.md")


@pytest.mark.parametrize("number", chapters.available())
def test_a_lesson_with_links_is_the_same_text(number) -> None:
    """What is taken out again leaves every byte; each term has one link, and none is left out."""
    text = (ROOT / "chapters" / chapters.folder_name(number) / "README.md").read_text("utf-8")
    shown = site_glossary.linked(Draft((number,)), text, f"chapters/ch{number:02d}.md")
    assert LINK.sub(r"\1", shown) == text
    found = [match[2] for match in LINK.finditer(shown)]
    wanted = [use.entry.anchor for use in glossary.first_uses(text, glossary.read().values())]
    assert found == wanted and len(set(found)) == len(found) > 10
    places = {match[4] for match in LINK.finditer(shown)} - {None}
    own = {f" #term-{entry.anchor}" for entry in glossary.read().values() if entry.chapter == number}
    assert places == own


def test_the_page_has_the_alphabet_and_a_way_to_each_chapter(known) -> None:
    draft = Draft((1, 5))
    assert site_glossary.entries(draft, "glossary.md").split("\n\n") == [
        "## B",
        "### barrier { #barrier }",
        "Lets work wait. [Chapter 1](chapters/ch01.md#term-barrier).",
        "## P",
        "### page { #page }",
        "A buffer. Unit: MiB. Chapter 2.",
        "## W",
        "### work group { #work-group }",
        "Runs together. Also called group of invocations. [Chapter 5](chapters/ch05.md#term-work-group).",
    ]


def test_a_glossary_that_is_wrong_costs_its_links_and_not_the_site(monkeypatch) -> None:
    def broken() -> dict[str, Entry]:
        raise UserError("The glossary is no TOML.")

    monkeypatch.setattr(glossary, "read", broken)
    draft = Draft()
    assert site_glossary.linked(draft, "a barrier", "a.md") == "a barrier"
    assert draft.lacks == ["a.md: links to the glossary. The glossary is no TOML."]


@pytest.mark.feature("tools/site")
def test_terms_lead_to_their_place_on_the_built_page(built) -> None:
    """Each link has its meaning as title and its place on the glossary's page, which leads back to it."""
    pages = {path.name: path.read_text("utf-8") for path in (built.folder / "chapters").glob("ch01*.html")}
    page = "".join(pages.values())
    words = (built.folder / "glossary.html").read_text("utf-8")
    entries = {entry.anchor: entry for entry in glossary.read().values()}
    links = re.findall(
        r'<a class="term" href="\.\./glossary\.html#([\w-]+)"( id="[\w-]+")? title="([^"]*)"', page
    )
    assert len(links) > 60
    for name, place, title in links:
        assert title == entries[name].says and f'<h3 id="{name}">' in words
        back = re.search(rf'href="chapters/(ch01[\w-]*\.html)#term-{name}"', words)
        assert (back is not None) == bool(place)
        assert back is None or f'id="term-{name}"' in pages[back[1]]
    assert words.count("<h3 ") == len(entries)
    assert ".term" not in re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)
