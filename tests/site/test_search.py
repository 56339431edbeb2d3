"""The search of the site, in pages that are served and in pages opened from disk, where browsers refuse workers."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import pytest

from tests.support.browser import Browser, Page
from tests.support.timing import PATIENCE_S

DESKTOP, PHONE = (1280, 900), (360, 740)
FIELD = "document.querySelector('[data-md-component=search-query]')"
SHOWN = "document.getElementById('__search').checked"
SAID = "document.querySelector('.md-search-result__meta').textContent.trim()"
FOUND = "[...document.querySelectorAll('.md-search-result__item')].map((one) => one.querySelector('a').href)"
LINKS = "[...document.querySelectorAll('.md-search-result__link')].map((one) => one.href.split('?')[0])"
MIDDLE = """(() => { const box = document.querySelector('%s').getBoundingClientRect();
  return [box.x + box.width / 2, box.y + box.height / 2]; })()"""


@pytest.fixture(scope="module", params=["from disk", "served"])
def where(request: pytest.FixtureRequest, built, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Where the site is; on disk in a folder whose name is not the same in an address."""
    if request.param == "served":
        return str(request.getfixturevalue("address"))
    folder = tmp_path_factory.mktemp("search") / "a site, #1 of 50%"
    folder.symlink_to(built.folder)
    return folder.as_uri()


@pytest.fixture(scope="module", params=[DESKTOP, PHONE], ids=["desktop", "phone"])
def searched(request: pytest.FixtureRequest, browser: Browser, where: str) -> Iterator[Page]:
    """A page of which the button of the search was pressed; its index is read once for all words."""
    opened = browser.open(f"{where}/chapters/ch01.html", *request.param)
    button = "header label[for=__search]" if request.param == PHONE else ".md-search__input"
    opened.point(*opened.value(MIDDLE % button), click=True)
    yield opened
    opened.close()


def test_the_index_is_there_as_a_script_too(built) -> None:
    folder = built.folder / "search"
    script = (folder / "search_index.js").read_text("utf-8")
    assert json.loads(script.removeprefix("var __index = ")) == json.loads(
        (folder / "search_index.json").read_text("utf-8")
    )


def look_up(opened: Page, words: str) -> None:
    """Write words into the field of the search once it has the focus, and wait until something is said of them.

    All but the last letter are pasted: each key that is pressed is a search of its own.
    """
    opened.until(f"{SHOWN} && document.activeElement === {FIELD}")
    opened.value(f"{FIELD}.select()")
    opened.paste(words[:-1])
    opened.type(words[-1])
    opened.until(f"{FIELD}.value === {json.dumps(words)} && / matching /.test({SAID})")


@pytest.mark.parametrize(
    ("words", "first", "also"),
    [
        ("prefiltered cube", "glossary.html", "glossary.html#prefiltered-cube"),
        ("forward renderer", "chapters/ch01.html", "chapters/ch01.html"),
    ],
)
def test_words_of_glossary_and_chapters_are_found(searched, where, words, first, also) -> None:
    look_up(searched, words)
    # What is found for the first letters alone may come before.
    searched.until(f"{FOUND}[0] === {json.dumps(f'{where}/{first}')}")
    searched.until(f"{LINKS}.includes({json.dumps(f'{where}/{also}')})")
    assert searched.complaints() == []
    assert [url for url in searched.requests() if not url.startswith((where, "data:", "about:"))] == []


def test_keys_are_enough(browser, where) -> None:
    opened = browser.open(f"{where}/index.html")
    opened.press("s")
    look_up(opened, "prefiltered cube")
    opened.until(f"{LINKS}.includes({json.dumps(f'{where}/glossary.html#prefiltered-cube')})")
    end = time.monotonic() + PATIENCE_S
    while not opened.value("(document.activeElement.href || '').endsWith('#prefiltered-cube')"):
        assert time.monotonic() < end, "no key led to the link"
        opened.press("ArrowDown")  # past what is above it; the list may still change, and then begins anew
    opened.press("Enter", "\r")
    opened.until(f"document.readyState === 'complete' && location.href.startsWith('{where}/glossary.html')")
    assert opened.value("location.hash") == "#prefiltered-cube"
    while not opened.value(
        SHOWN
    ):  # of a page that has just come the theme may hear the key, and not yet the field
        assert time.monotonic() < end, "the key for the search does nothing"
        opened.value("document.activeElement.blur()")
        opened.press("s")
        time.sleep(0.1)
    opened.press("Escape")
    opened.until(f"!{SHOWN}")
    assert opened.complaints() == []
    opened.close()


def test_what_is_nowhere_is_said_to_be(browser, where) -> None:
    opened = browser.open(f"{where}/index.html")
    opened.press("s")
    look_up(opened, "xylophone")
    opened.until(f"{SAID} === 'No matching documents'")
    assert opened.value(FOUND) == []
    opened.close()


def test_a_served_page_searches_in_a_real_worker(browser, address) -> None:
    opened = browser.open(f"{address}/index.html")
    assert "[native code]" in opened.value("String(Worker)")
    assert opened.value("document.querySelectorAll('iframe').length") == 0
    opened.close()
