"""Redirects from the addresses that pages of source files had before the files moved.

docs/site/moved.json    the old path and the new one of each file: "chapters" has paths inside a chapter, the same for
                        every chapter that has the new file; "repository" has paths from the root
"""

from __future__ import annotations

import json
import posixpath
import re
from html import escape

from common.paths import ROOT
from tools.site.draft import Draft

TABLE = ROOT / "docs" / "site" / "moved.json"
_FOLLOWS = "location.replace(document.querySelector('a').getAttribute('href') + location.hash)"
"""Keeps the number of the line, which a refresh would lose."""


def table() -> dict[str, dict[str, str]]:
    """Return the new path of each old one, for "chapters" and for the "repository"."""
    found: dict[str, dict[str, str]] = json.loads(TABLE.read_text("utf-8"))
    return found


def add(draft: Draft) -> None:
    """Add a page at each old address whose file has a page at its new one."""
    moved = table()
    folders = {path.split("/")[2] for path in draft.files if re.match(r"source/chapters/ch\d\d/", path)}
    paths = dict(moved["repository"])
    for folder in sorted(folders):
        for old, new in moved["chapters"].items():
            paths[f"chapters/{folder}/{old}"] = f"chapters/{folder}/{new}"
    for old, new in paths.items():
        place, goal = f"source/{old}.html", f"source/{new}.html"
        if place not in draft.files and goal in draft.files:
            draft.files[place] = page(new, posixpath.relpath(goal, posixpath.dirname(place))).encode()


def page(path: str, link: str) -> str:
    """Return the page that leads to the new address of a file, with and without scripts."""
    name, to = escape(path), escape(link)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f'<link rel="canonical" href="{to}">'
        f'<noscript><meta http-equiv="refresh" content="0; url={to}"></noscript></head>'
        f'<body><p>This file is now <a href="{to}">{name}</a>.</p><script>{_FOLLOWS}</script></body></html>\n'
    )
