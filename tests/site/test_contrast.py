"""Letters, plots, handles, tables and code can be told from what is behind them, in light colours and in dark ones."""

from __future__ import annotations

import json

import pytest

from common.paths import ROOT
from tests.support import contrast
from tools.site import code

LONG = pytest.mark.long
PAGES = {
    "chapters/ch01-pictures.html": "handles",
    "chapters/ch01-measured.html": "plots",
    "chapters/ch01-light-in-numbers.html": "figures",
    "notebook.html": "code",
    "index.html": "tables",
    "features.html": "a form",
}
OTHERS = ("setup.html", "accuracy.html", "speed.html", "glossary.html", "maintaining.html", "records.html")
LACK = "document.querySelector('.md-typeset').insertAdjacentHTML('beforeend', '<p class=lack>It lacks this.</p>')"
"""What a page says that lacks something; the site of these tests lacks nothing."""
both = pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])


@both
@pytest.mark.parametrize(
    "page", [*PAGES, *(pytest.param(page, marks=LONG) for page in (*OTHERS, "contributing.html"))]
)
def test_everything_on_a_page_has_contrast(browser, address, page, dark) -> None:
    opened = browser.open(f"{address}/{page}", dark=dark)
    opened.value(LACK)
    seen = contrast.of(opened)
    assert (seen.scheme, seen.dark) == ("slate" if dark else "default", dark)
    assert seen.found == []
    assert seen.letters > 30 and seen.marks >= len(contrast.STATES)
    opened.close()


@both
def test_the_parts_of_a_chapter_s_page_are_all_looked_at(browser, address, dark) -> None:
    """A selector that nothing answers to would look at nothing."""
    missing = {
        selector
        for selector, *_ in contrast.MARKS
        if not selector.endswith((".lack", ".search-features input"))
    }
    for name in ("pictures", "measured"):
        opened = browser.open(f"{address}/chapters/ch01-{name}.html", dark=dark)
        missing -= {one for one in missing if opened.value(f"document.querySelectorAll({one!r}).length")}
        if name != "measured":
            opened.close()
    assert missing == set()
    paper = "getComputedStyle(document.body).backgroundColor"
    opened.value(f"document.querySelectorAll('.plot text').forEach((one) => one.style.fill = {paper})")
    found = contrast.of(opened).found
    assert found and all(one.startswith(("text", "g.point")) for one in found), found
    opened.close()


@both
@pytest.mark.parametrize("path", ["chapters/ch01/settings.py", "chapters/ch01/post/tonemap.frag"])
def test_code_has_contrast_in_its_colours(browser, tmp_path, path, dark) -> None:
    """Of pages that show a file, which have no theme; those of differences have the same colours."""
    (tmp_path / "code.html").write_text(code.page(path, (ROOT / path).read_bytes()), "utf-8")
    opened = browser.open((tmp_path / "code.html").as_uri(), dark=dark)
    colours = opened.value(
        "new Set([...document.querySelectorAll('.code span')].map((one) => getComputedStyle(one).color)).size"
    )
    seen = contrast.of(opened)
    assert seen.found == [] and seen.dark == dark and colours > 3
    opened.close()


PAGE = """<!doctype html><title>a page</title><style>
body {{ background: {paper}; color: {ink}; }} svg text {{ fill: {text}; font-size: 14px; }}
.plot .front {{ stroke: {line}; stroke-opacity: {clear}; fill: none; }} p.large {{ font-size: 30px; color: {large}; }}
</style><body><p>words</p><p class="large">large words</p><figure class="plot"><svg width="200" height="90">
<text x="9" y="20">a word in a drawing</text><polyline class="front" points="0,0 90,90"/></svg></figure>"""
GOOD = {
    "paper": "#fff",
    "ink": "#767676",  # 4.54 to 1, the lightest grey that serves
    "text": "#767676",
    "large": "#949494",  # 3.03
    "line": "#000",
    "clear": 0.42,
}
DARK = {
    "paper": "#000",
    "ink": "#757575",  # 4.56, the darkest
    "text": "#757575",
    "large": "#5a5a5a",  # 3.04
    "line": "#fff",
    "clear": 0.36,
}


@pytest.mark.parametrize("given", [GOOD, DARK], ids=["light", "dark"])
def test_enough_is_enough_and_a_little_less_is_named(browser, tmp_path, given) -> None:
    """The greys nearest to the bounds, as the definition of relative luminance has them."""
    weaker = {"ink": "#777777", "text": "#777777", "large": "#969696", "clear": 0.41}
    if given is DARK:
        weaker = {"ink": "#747474", "text": "#747474", "large": "#585858", "clear": 0.33}
    where = {"ink": "p rgb", "text": "text rgb", "large": "p.large", "clear": "polyline.front"}
    (tmp_path / "page.html").write_text(PAGE.format(**given), "utf-8")
    opened = browser.open((tmp_path / "page.html").as_uri())
    for change in (None, *weaker):
        values = given if change is None else given | {change: weaker[change]}
        style = json.dumps(PAGE.format(**values).partition("<style>")[2].partition("</style>")[0])
        opened.value(f"document.querySelector('style').textContent = {style}")
        found = contrast.of(opened).found
        if change is None:
            assert found == []
        else:
            assert len(found) == 1 and where[change] in found[0], (change, found)
    opened.close()


def test_a_page_in_the_dark_is_dark_though_another_was_light_before(browser, address) -> None:
    """The theme remembers the scheme that a reader saw first; a page of the test is that of a reader who is new."""
    schemes = []
    for dark in (False, True):
        opened = browser.open(f"{address}/index.html", dark=dark)
        schemes.append(opened.value("document.body.dataset.mdColorScheme"))
        opened.close()
    assert schemes == ["default", "slate"]
