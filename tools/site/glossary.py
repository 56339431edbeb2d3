"""The glossary on the site: its page, and links to it from the first use of each term in every lesson.

Links are made while pages are put together and do not stand in the READMEs, where several hundred of them would stand
in the way of whoever reads in a terminal or an editor; bold is all that a text needs to say which word is a term.
"""

from __future__ import annotations

import posixpath
from collections.abc import Collection

import chapters
from common.errors import UserError
from tools.ledger import glossary
from tools.ledger.glossary import Entry
from tools.site.draft import Draft

PAGE = "glossary.md"


def linked(draft: Draft, text: str, page: str) -> str:
    """Return a text of Markdown whose first use of each term leads to the glossary; the meaning is the link's title."""
    try:
        entries = glossary.read().values()
    except UserError as error:
        draft.lack(page, f"links to the glossary. {error}")
        return text
    parts, behind = [], 0
    to = posixpath.relpath(PAGE, posixpath.dirname(page) or ".")
    for use in glossary.first_uses(text, entries):
        place = f" #{anchor(use.entry)}" if use.bold else ""
        words = text[use.start : use.end]
        parts.append(text[behind : use.start])
        parts.append(f'[{words}]({to}#{use.entry.anchor} "{use.entry.says}"){{ .term{place} }}')
        behind = use.end
    return "".join([*parts, text[behind:]])


def anchor(entry: Entry) -> str:
    """Return the name of the place on a chapter's page where it introduces a term."""
    return f"term-{entry.anchor}"


def entries(draft: Draft, page: str) -> str:
    """Return all terms by the alphabet, each with a heading of its own, so that the search of the site finds it."""
    letter, lines = "", []
    for entry in glossary.read().values():
        if entry.name[0].upper() != letter:
            letter = entry.name[0].upper()
            lines.append(f"## {letter}")
        lines.append(f"### {entry.name} {{ #{entry.anchor} }}\n\n{said(entry, draft.chapters)}")
    return "\n\n".join(lines)


def said(entry: Entry, linked_chapters: Collection[int]) -> str:
    """Return what the page says of a term: its sentence, its unit, other names, and where it is introduced."""
    where = f"Chapter {entry.chapter}"
    if entry.chapter in linked_chapters:
        where = f"[{where}](chapters/{chapters.folder_name(entry.chapter)}.md#{anchor(entry)})"
    unit = f" Unit: {entry.unit}." if entry.unit else ""
    also = f" Also called {', '.join(entry.also)}." if entry.also else ""
    return f"{entry.says}{unit}{also} {where}."
