"""What the site is made of before mkdocs sees it: pages of Markdown, files beside them, and what each page lacks.

Texts of the repository link to each other, to code and to pictures by their place in the clone. Here those links become
links of the site: to the page of a text, to a page that shows the code, to a copy of the picture.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from common.paths import ROOT
from tools.site import code
from tools.site.parts import Split

PICTURES = (".png", ".jpg", ".svg", ".webp")
TEXTS = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "NOTICE.md": "notice.md",
    "docs/benchmarks/README.md": "records.md",
    "examples/notebook.ipynb": "notebook.md",
}
"""Texts of the repository that are pages, beside those of chapters."""

_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s]+)\)")
_SOURCE = re.compile(r'(?<= )(src|srcset)="([^":]+)"')
"""Of tags of HTML in a text: a loop is a <picture>."""
_FENCE = re.compile(r"^(```.*?^```\s*$)", re.MULTILINE | re.DOTALL)


@dataclass
class Draft:
    """Pages by their path in the site ("chapters/ch04.md"), other files by theirs, and sentences on what is missing."""

    chapters: tuple[int, ...] = ()
    """The chapters that get a page."""
    pages: dict[str, str] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    lacks: list[str] = field(default_factory=list)
    split: dict[str, Split] = field(default_factory=dict)
    """The pages of a chapter by the first of them, which other pages name."""

    def lack(self, page: str, what: str) -> str:
        """Note that a page lacks something, and return the sentence that stands there in its place, as HTML.

        What a user can type stands between backticks.
        """
        self.lacks.append(f"{page}: {what}")
        shown = re.sub("`([^`]+)`", r"<code>\1</code>", escape(what))
        return f'<p class="lack">Not here: {shown}</p>'

    def attempt(self, page: str, what: str, make: Callable[[], str]) -> str:
        """Return what `make` returns; where it fails in any way, the sentence that says so."""
        try:
            return make()
        except (Exception, SystemExit) as error:  # a chapter that is being edited may fail in any way
            return self.lack(page, f"{what}, since {reason(error)}.")

    def add_text(self, path: str, page: str, title: str = "") -> None:
        """Make a text of the repository a page; what it links to comes along.

        Without the text the page has its title, so that links to it lead somewhere.
        """

        def read() -> str:
            return self.localised((ROOT / path).read_text("utf-8"), path, page)

        if (ROOT / path).is_file():
            self.pages[page] = self.attempt(page, f"the text of {path}", read)
        else:
            self.pages[page] = f"# {title or page}\n\n{self.lack(page, f'its text: {path} is missing.')}\n"

    def localised(self, text: str, path: str, page: str) -> str:
        """Return Markdown that stands at `path` of the repository with links that hold on `page` of the site."""
        parts = _FENCE.split(text)
        for index in range(0, len(parts), 2):  # the others are code
            parts[index] = _LINK.sub(lambda found: self._link(found, path, page), parts[index])
            parts[index] = _SOURCE.sub(lambda found: self._source(found, path, page), parts[index])
        return "".join(parts)

    def _source(self, found: re.Match[str], path: str, page: str) -> str:
        asked = posixpath.normpath(posixpath.join(posixpath.dirname(path), found[2]))
        return f'{found[1]}="{self.file(asked, page) or found[2]}"'

    def _link(self, found: re.Match[str], path: str, page: str) -> str:
        mark, words, target = found.groups()
        where, hash_, fragment = target.partition("#")
        if not where or re.match(r"[a-z]+:", target):
            return found[0]
        asked = posixpath.normpath(posixpath.join(posixpath.dirname(path), where))
        to = self.file(asked, page)
        return f"{mark}[{words}]({to}{hash_}{fragment})" if to else found[0]

    def file(self, path: str, page: str) -> str:
        """Return the link from a page to what shows a file or folder of the repository; "" where there is none.

        Pictures are copied; code and folders get pages of their own.
        """
        place, full = self.page_of(path), ROOT / path
        if not place:
            if path.startswith("..") or not full.exists():
                self.lack(page, f"what it links to, {path}, is not in the repository.")
                return ""
            place = self._place(path, full)
        return posixpath.relpath(place, posixpath.dirname(page) or ".")

    def page_of(self, path: str) -> str:
        """Return the page of a text of the repository, "" if it has none."""
        chapter = re.fullmatch(r"chapters/ch(\d\d)(?:/README\.md)?", path)
        if chapter and int(chapter[1]) in self.chapters:
            return f"chapters/ch{chapter[1]}.md"
        return TEXTS.get(path, "")

    def _place(self, path: str, full: Path) -> str:
        if full.suffix in PICTURES or (full.suffix == ".json" and path.startswith("docs/")):
            place = path.removeprefix("docs/")
            self.files.setdefault(place, full.read_bytes())
            return place
        place = f"source/{path}/index.html" if full.is_dir() else f"source/{path}.html"
        if place not in self.files:
            self.files[place] = b""  # a folder's files link back to it
            if full.is_dir():
                names = [one.name for one in sorted(full.iterdir()) if code.is_shown(one)]
                linked = path.startswith("chapters/")  # what is read is there; of tests a list is enough
                links = {name: self.file(f"{path}/{name}", place) if linked else "" for name in names}
                self.files[place] = code.folder_page(path, links).encode()
            else:
                self.files[place] = code.page(path, full.read_bytes()).encode()
        return place


def reason(error: BaseException) -> str:
    """Return the first line of what an error says, as the end of a sentence; a key alone says too little."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return f"{lines[0]} is missing" if isinstance(error, KeyError) else lines[0].rstrip(".")
