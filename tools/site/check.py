"""Read the pages of a built site and say what is wrong: dead links, pictures without words, foreign hosts."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path
from urllib.parse import unquote

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""Tags and attributes by which a page loads something as soon as it is opened."""
_TAG = re.compile(r"<(a|img|link|script|source|iframe|html)\b([^>]*)>")
_ATTRIBUTE = re.compile(r"""([\w:-]+)(?:=(?:"([^"]*)"|'([^']*)'|([^\s"'>]+)))?""")
_ID = re.compile(r"""\bid=(?:"([^"]+)"|'([^']+)'|([^\s"'>]+))""")
_CODE = re.compile(r"<script\b[^>]*>.*?</script>|<style\b[^>]*>.*?</style>|<!--.*?-->", re.DOTALL)


@dataclass
class Page:
    """What a page refers to: (tag, attributes) in order, and the places in it that links can lead to."""

    tags: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    ids: set[str] = field(default_factory=set)


def read(text: str) -> Page:
    """Return what is in a page of HTML; scripts are left out, except where they come from."""
    found = Page()
    bare = _CODE.sub(
        lambda part: part[0].partition(">")[0] + ">" if part[0].startswith("<script") else "", text
    )
    for tag, rest in _TAG.findall(bare):
        values = {name.lower(): unescape(a or b or c) for name, a, b, c in _ATTRIBUTE.findall(rest)}
        found.tags.append((tag, values))
    found.ids = {unescape(a or b or c) for a, b, c in _ID.findall(bare)}
    return found


def faults(folder: Path) -> list[str]:
    """Return a sentence for everything that is wrong in the pages of a folder, at most one for each link of a page."""
    pages = {
        path.relative_to(folder).as_posix(): read(path.read_text("utf-8"))
        for path in sorted(folder.rglob("*.html"))
    }
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    found = []
    for name, page in pages.items():
        found += [f"{name} {fault}" for fault in dict.fromkeys(_of_page(name, page, pages, files))]
    return found


def _of_page(name: str, page: Page, pages: dict[str, Page], files: set[str]) -> Iterator[str]:
    for tag, values in page.tags:
        if tag == "html" and not values.get("lang"):
            yield "does not say its language."
        if tag == "img" and not values.get("alt", "").strip():
            yield f"shows {values.get('src')} without words for those who do not see it."
        attribute = LOADED.get(tag, "href")
        target = values.get(attribute, "")
        if tag in LOADED and re.match(r"(https?:)?//", target):
            yield f"loads {target} from another machine."
        elif (tag in LOADED or tag == "a") and attribute in values:
            yield from _link(name, target, page, pages, files)


def _link(name: str, target: str, page: Page, pages: dict[str, Page], files: set[str]) -> Iterator[str]:
    if re.match(r"[a-z][a-z+.-]*:|//", target):
        return
    where, _, fragment = unquote(target).partition("#")
    where = where.partition("?")[0]
    to = posixpath.normpath(posixpath.join(posixpath.dirname(name), where)) if where else name
    if to not in files:
        yield f"links to {target}, which is not there."
    elif fragment and to in pages and fragment not in pages[to].ids:
        yield f"links to {target}, and there is no such place on that page."
