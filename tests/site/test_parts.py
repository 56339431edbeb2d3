"""A chapter over several pages: each heading is on one of them, links find it there, and old addresses lead to it."""

from __future__ import annotations

import re

import pytest

import chapters
from tests.site.test_build import pages
from tools.lessons import sections
from tools.site import parts
from tools.site.parts import Split, relinked, slug, split

pytestmark = pytest.mark.feature("tools/site")

TEXT = """# Chapter 1: a test

## The idea

Before.

### A frame

> **Section 1.**

```
# no heading
```

#### Inside of it

See [below](#exercises), [light](#light-in-numbers) and [the other](#inside-of-it_1).

### What a draw costs

{ #term-cost } [A term](../glossary.md#cost){ .term #term-draw }

#### Inside of it

## Try it

First.

### Beside the way: studies

#### phong

### Light in numbers

Watts.

## Exercises

### Hard ones

## Unknown

Stays.
"""


@pytest.fixture
def made(monkeypatch) -> Split:
    known = sections.parts(1)
    chosen = [
        part for part in known if part.section.title in ("A frame", "What a draw costs", "Light in numbers")
    ]
    monkeypatch.setattr(sections, "parts", lambda number: chosen)
    return split(1, TEXT)


def test_each_section_has_a_page_and_the_rest_of_the_text_goes_where_it_is_looked_up(made) -> None:
    names = ["", "-a-frame", "-what-a-draw-costs", "-light-in-numbers", "-studies", "-try", "-exercises"]
    assert [*made.pages] == [f"chapters/ch01{name}.md" for name in names]
    frame = made.pages["chapters/ch01-a-frame.md"]
    assert frame.startswith(
        "# A frame { #a-frame }\n\n> **Section 1.**\n\n```\n# no heading\n```\n\n## Inside of it\n"
    )
    assert (
        made.pages["chapters/ch01-studies.md"]
        == "# Chapter 1: studies { #studies }\n\n## Beside the way: studies\n\n### phong\n"
    )
    assert made.pages["chapters/ch01-exercises.md"].endswith("}\n\n### Hard ones\n")
    front = made.pages["chapters/ch01.md"]
    assert "Before." in front and "## Unknown\n\nStays." in front and "First." not in front
    assert "| 1 | [A frame](ch01-a-frame.md) | 25 |" in front and "[Exercises](ch01-exercises.md)" in front


def test_places_are_where_their_headings_went(made) -> None:
    assert made.places["a-frame"] == ("chapters/ch01-a-frame.md", "a-frame")
    assert made.places["inside-of-it"] == ("chapters/ch01-a-frame.md", "inside-of-it")
    assert made.places["inside-of-it_1"] == ("chapters/ch01-what-a-draw-costs.md", "inside-of-it")
    assert made.places["term-draw"][0] == made.places["term-cost"][0] == "chapters/ch01-what-a-draw-costs.md"
    assert made.places["the-idea"] == ("chapters/ch01.md", "the-idea")
    assert "no-heading" not in made.places


def test_links_of_all_pages_lead_there(made) -> None:
    front = "chapters/ch01.md"
    other = "[a](chapters/ch01.md#exercises) [b](chapters/ch01.md) [c](chapters/ch01.md#nowhere) `[d](#exercises)`"
    coded = '```\n[a](chapters/ch01.md#exercises)\n```\n<a href="chapters/ch01.html#hard-ones">'
    found = relinked({**made.pages, "index.md": other, "setup.md": coded}, {front: made})
    frame = found["chapters/ch01-a-frame.md"]
    assert "[below](ch01-exercises.md#exercises)" in frame
    assert "[light](ch01-light-in-numbers.md#light-in-numbers)" in frame
    assert "[the other](ch01-what-a-draw-costs.md#inside-of-it)" in frame
    assert found["index.md"].startswith(
        "[a](chapters/ch01-exercises.md#exercises) [b](chapters/ch01.md) [c](chapters/ch01.md#nowhere)"
    )
    assert (
        found["setup.md"]
        == '```\n[a](chapters/ch01.md#exercises)\n```\n<a href="chapters/ch01-exercises.html#hard-ones">'
    )


def test_names_of_places_are_those_that_markdown_gives() -> None:
    toc = pytest.importorskip("markdown.extensions.toc")
    for words in (
        "What a draw costs",
        "Time & error: 2 × 3",
        "`code` here",
        "Größe, naïve",
        "a - b",
        "Loading  beside",
    ):
        assert slug(words) == toc.slugify(words.replace("`", ""), "-"), words


def test_no_section_takes_the_address_of_another_page() -> None:
    for number in chapters.available():
        names = [slug(part.section.title) for part in sections.parts(number)]
        assert len({*names}) == len(names) and not {*names} & {*parts.AROUND, "diff", "graph"}


def test_the_pages_of_the_built_site_have_each_heading_of_the_lesson_once(built) -> None:
    found = pages(built)
    headings = re.findall(
        r"^#{2,4} (.+)$",
        re.sub(r"```.*?```", "", (chapters.FOLDER / "ch01/README.md").read_text("utf-8"), flags=re.DOTALL),
        re.MULTILINE,
    )
    shown = [
        re.sub(r"<[^>]*>|&para;|¶", "", words)
        for name, text in found.items()
        if re.fullmatch(r"chapters/ch01[\w-]*\.html", name)
        for words in re.findall(r"<h[1-4] id=[^>]*>(.*?)</h[1-4]>", text, re.DOTALL)
    ]
    bare = [re.sub(r"`|\[|\]\([^)]*\)", "", words) for words in headings]
    titles = {title: f"Chapter 1: {title.lower()}" for title, _ in parts.AROUND.values()}
    for words in bare:
        count = shown.count(words) + (shown.count(titles[words]) if words in titles else 0)
        assert count == 1, words


@pytest.mark.parametrize("place", ["two-frames-at-once", "exercises", "the-idea", "nowhere"])
def test_an_address_of_the_one_page_leads_to_the_place_now(browser, address, built, place) -> None:
    opened = browser.open(f"{address}/chapters/ch01.html#{place}")
    expected = {
        "two-frames-at-once": "/chapters/ch01-a-frame.html",
        "exercises": "/chapters/ch01-exercises.html",
    }.get(place, "/chapters/ch01.html")
    assert opened.value("location.pathname") == expected
    assert opened.value("location.hash") == f"#{place}"
    assert opened.value(f"document.getElementById('{place}') !== null") == (place != "nowhere")
    opened.close()
