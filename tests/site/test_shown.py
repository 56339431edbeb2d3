"""The pages in a headless Chromium: no complaint, handles move, plots tell, phones fit, rules of accessibility hold."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

from tools.diff.page import allowed
from tools.diff.style import SCRIPT
from tools.ledger import features
from tools.site import records
from tools.site.code import following
from tools.site.figures.plot import short

LONG = pytest.mark.long
CODE = "source/chapters/ch01/renderer.py.html"
OTHERS = (
    "setup.html",
    "accuracy.html",
    "speed.html",
    "features.html",
    "glossary.html",
    "maintaining.html",
    "contributing.html",
    "notebook.html",
)
PAGES = [
    "index.html",
    "chapters/ch01.html",
    "chapters/ch01-a-frame.html",
    CODE,
    *(pytest.param(page, marks=LONG) for page in OTHERS),
]


@pytest.mark.parametrize("page", PAGES)
def test_pages_load_without_a_complaint_and_from_here_alone(browser, address, page) -> None:
    opened = browser.open(f"{address}/{page}")
    assert opened.complaints() == []
    foreign = [url for url in opened.requests() if not url.startswith((f"{address}/", "data:", "blob:"))]
    assert foreign == []
    opened.close()


@pytest.mark.parametrize("page", PAGES)
def test_a_phone_s_width_is_enough(browser, address, page) -> None:
    opened = browser.open(f"{address}/{page}", 360, 740)
    assert opened.value("document.scrollingElement.scrollWidth") <= 360
    opened.close()


def test_letters_of_a_figure_can_be_read_on_a_phone(browser, address) -> None:
    """A figure is scrolled within its place, by keys too, and the page itself is not."""
    opened = browser.open(f"{address}/chapters/ch01-a-frame.html", 390, 740)
    sizes = (
        "[...document.querySelectorAll('.figure svg text')].map((one) => one.getBoundingClientRect().height)"
    )
    assert min(opened.value(sizes)) > 8
    figure = "document.querySelector('.figure')"
    assert (
        opened.value(f"{figure}.scrollWidth > {figure}.clientWidth")
        and opened.value(f"{figure}.tabIndex") == 0
    )
    assert opened.value("document.scrollingElement.scrollWidth") <= 390
    opened.close()


def test_the_handle_moves_by_keys_and_by_the_pointer(browser, address) -> None:
    opened = browser.open(f"{address}/chapters/ch01-pictures.html")
    at = "getComputedStyle(document.querySelector('.pair')).getPropertyValue('--at')"
    clip = "getComputedStyle(document.querySelector('.over')).clipPath"
    assert opened.value(at) == "50" and "50%" in opened.value(clip)
    opened.value("document.querySelector('.handle input').focus()")
    opened.press("ArrowRight")
    assert opened.value(at) == "51" and "51%" in opened.value(clip)
    opened.press("Home")
    assert opened.value(at) == "0"
    opened.value("document.querySelector('.pair').scrollIntoView({block: 'center', behavior: 'instant'})")
    box = json.loads(opened.value("JSON.stringify(document.querySelector('.pair').getBoundingClientRect())"))
    opened.point(box["x"] + 0.25 * box["width"], box["y"] + box["height"] / 2, click=True)
    assert int(opened.value(at)) == pytest.approx(25, abs=1)
    assert int(opened.value("document.querySelector('.handle input').value")) == pytest.approx(25, abs=1)
    opened.close()


def test_one_pair_is_shown_at_a_time(browser, address) -> None:
    opened = browser.open(f"{address}/chapters/ch01-pictures.html")
    shown = "[...document.querySelectorAll('.overlay')].map((e) => getComputedStyle(e).display !== 'none')"
    count = len(opened.value(shown))
    assert count > 1 and opened.value(shown) == [True] + [False] * (count - 1)
    opened.value("document.querySelector('.overlays select').value = 1")
    opened.value("document.querySelector('.overlays select').dispatchEvent(new Event('change'))")
    assert opened.value(shown) == [False, True] + [False] * (count - 2)
    opened.close()


def test_a_plot_tells_the_numbers_of_the_point_that_is_pointed_at(browser, address) -> None:
    opened = browser.open(f"{address}/chapters/ch01-measured.html")
    name, made = next(iter(records.records_of(1).items()))
    plot = f"document.querySelector('.plot[data-record=\"{name}\"]')"
    names = opened.value(f"[...{plot}.querySelectorAll('.point')].map((p) => p.dataset.name)")
    assert sorted(names) == sorted(point["name"] for point in made["points"])
    low = next(point for point in made["points"] if point["name"] == "low")
    point = f"{plot}.querySelector('[data-name=low]')"
    opened.value(f"{point}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    x, y = opened.value(
        f"(() => {{ const b = {point}.querySelector('circle').getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    said = f"{plot}.querySelector('.hover').textContent"
    before = opened.value(said)
    opened.point(x, y)
    assert opened.value(said).startswith(f"low: {short(low['gpu_ms'])} ms")
    opened.point(2, 2)
    assert opened.value(said) == before
    opened.value(f"{point}.focus()")
    assert opened.value(said).startswith("low: ")
    opened.close()


def test_features_are_found_by_words(browser, address) -> None:
    opened = browser.open(f"{address}/features.html")
    shown = "[...document.querySelectorAll('.features tbody tr:not([hidden])')].length"
    every = opened.value(shown)
    assert every == len(features.marked_tests())
    field = "document.querySelector('.search-features input')"
    opened.value(f"{field}.value = 'Frame graph BARRIERS'; {field}.dispatchEvent(new Event('input'))")
    found = len([one for one in features.features() if one.matches("frame graph barriers")])
    assert 0 < opened.value(shown) == found < every
    assert (
        opened.value("document.querySelector('.search-features output').textContent") == f"{found} of {every}"
    )
    empty = (
        "[...document.querySelectorAll('.features')].filter((one) => one.offsetHeight && !one.querySelector("
    )
    assert opened.value(f"{empty}'tbody tr:not([hidden])')).length") == 0
    opened.close()


def _axe() -> str:
    package = importlib.util.find_spec("axe_core_python")
    if package is None or not package.submodule_search_locations:
        pytest.skip("the package axe-core-python is not installed")
    return Path(next(iter(package.submodule_search_locations)), "axe.min.js").read_text("utf-8")


RUN = """axe.run(%s, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}).then((found) =>
  JSON.stringify(found.violations.map((v) => [v.id, v.nodes.slice(0, 3).map((n) => n.html + n.failureSummary)])))"""


@pytest.mark.parametrize(
    ("page", "dark", "part"),
    [
        ("chapters/ch01-pictures.html", False, {"include": [[".gallery"], [".overlays"]]}),
        ("chapters/ch01-measured.html", False, {"include": [[".plots"]]}),
        ("index.html", True, {}),
        *(
            pytest.param(page, dark, {}, marks=LONG)
            for page in ("index.html", "chapters/ch01.html", CODE, *OTHERS)
            for dark in (False, True)
        ),
    ],
)
def test_rules_of_accessibility_hold(browser, address, page, dark, part) -> None:
    opened = browser.open(f"{address}/{page}", dark=dark)
    opened.value(_axe())
    assert json.loads(opened.value(RUN % (json.dumps(part) if part else "document"))) == []
    opened.close()


@pytest.mark.parametrize("page", [CODE, "chapters/ch02-diff.html"])
def test_code_is_dark_where_the_reader_chose_dark_pages(browser, address, built, page) -> None:
    if not (built.folder / page).is_file():  # the site of one chapter has no differences: one is made up
        csp = f"<meta http-equiv=Content-Security-Policy content=\"default-src 'none'; {allowed(SCRIPT)}\">"
        (built.folder / page).write_text(following(f"<html><head>{csp}</head></html>", "../"), "utf-8")
    opened = browser.open(f"{address}/chapters/ch01.html")
    shown = """new Promise((done) => {
      const frame = document.createElement("iframe");
      frame.onload = () => done(frame.contentDocument.documentElement.dataset.theme || "as the system");
      frame.src = "%s"; document.body.append(frame); })"""
    address_of = f"{address}/{page}"
    assert opened.value(shown % address_of) in ("light", "as the system")
    opened.value("document.querySelector('[data-md-component=palette] label:not([hidden])').click()")
    assert opened.value(shown % address_of) == "dark"
    assert opened.complaints() == []
    opened.close()
