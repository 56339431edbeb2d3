"""The words of the course, and where a lesson uses them: docs/glossary.toml, and texts of Markdown held against it.

In a README **bold** has two uses, which its last sign tells apart. A *lead* begins a paragraph or an item and ends with
a full stop, a colon or a question mark. Everything else that is bold is a *term* of the glossary, where the course
uses it for the first time.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.paths import ROOT

FILE = ROOT / "docs" / "glossary.toml"
LEAD = (".", ":", "?", "!")
"""How bold ends that is no term."""
FIELDS: dict[str, type] = {"says": str, "chapter": int, "unit": str, "also": list, "everyday": bool}
"""What an entry of the file can have."""

_BOLD = re.compile(r"\*\*(?=\S)((?:[^*\0]|\*(?!\*))+?)(?<=\S)\*\*")
_NO_PROSE = [
    re.compile(r"^```.*?^```\s*$", re.MULTILINE | re.DOTALL),
    re.compile(r"^## Further reading\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL),
    re.compile(r"^#+ .*$", re.MULTILINE),
    re.compile(r"!?\[(?:[^\[\]]|\[[^\[\]]*\])*\]\([^()\s]*\)"),
    re.compile(r"`(?:[^`\n]|\n(?!\s*\n))+`"),
    re.compile(r"<!--.*?-->|</?[a-zA-Z][^<>]*>", re.DOTALL),
]
"""What is in a text and not read as prose: code, titles of books, headings, links, HTML."""


@dataclass(frozen=True)
class Entry:
    """A word: what it means in a sentence, the chapter that introduces it, its unit, and what else it is called.

    An `everyday` word has other meanings too, so that only bold tells that this one is meant.
    """

    name: str
    says: str
    chapter: int
    unit: str = ""
    also: tuple[str, ...] = ()
    everyday: bool = False

    @property
    def anchor(self) -> str:
        """Its place on the page of the glossary: "g-buffer"."""
        return re.sub(r"[^\w]+", "-", self.name.lower().replace("'", "")).strip("-")

    @property
    def forms(self) -> tuple[str, ...]:
        """All that it is called, plurals included."""
        names = (self.name, *self.also)
        return tuple(dict.fromkeys([*names, *map(plural, names)]))


@dataclass(frozen=True)
class Use:
    """Where a text uses a word of the glossary: from `start` to `end`, the signs of bold included."""

    entry: Entry
    start: int
    end: int
    bold: bool


def plural(name: str) -> str:
    """Return the regular plural of a word."""
    if re.search(r"[^aeiou]y$", name):
        return f"{name[:-1]}ies"
    return name + ("es" if re.search(r"(s|x|z|ch|sh)$", name) else "s")


def normal(text: str) -> str:
    """Return a word as it is looked for: small letters, one space in place of spaces, hyphens and underscores."""
    return re.sub(r"[\s_-]+", " ", text.casefold()).strip()


@cache
def read(path: Path = FILE) -> dict[str, Entry]:
    """Return the glossary by name, in the order of its file.

    Raises UserError where the file is missing or no TOML, and where an entry is not as it should be.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise UserError(f"The glossary {path} cannot be read: {error.strerror or error}.") from None
    except ValueError as error:
        raise UserError(f"The glossary {path} is no TOML: {error}.") from None
    return {name: _entry(name, found, path) for name, found in table.items()}


def _entry(name: str, found: Any, path: Path) -> Entry:
    if not normal(name):
        raise UserError(f"In the glossary {path}, an entry has no name.")
    fields = found if isinstance(found, dict) else {}
    wrong = [key for key, value in fields.items() if key not in FIELDS or not isinstance(value, FIELDS[key])]
    missing = [key for key in ("says", "chapter") if key not in fields]
    if wrong or missing:
        what = f"{missing[0]} is missing" if missing else f"{wrong[0]} cannot be {fields[wrong[0]]!r}"
        raise UserError(f"In the glossary {path}, {name!r} is not as it should be: {what}.")
    return Entry(name, **{**fields, "also": tuple(fields.get("also", ()))})


def by_form(entries: Iterable[Entry]) -> dict[str, Entry]:
    """Return the entry of each form of a word, in its normal form."""
    return {normal(form): entry for entry in entries for form in entry.forms}


def prose(text: str) -> str:
    """Return a text of the same length in which all that is not read as prose, leads included, is zeros."""
    for pattern in _NO_PROSE:
        text = pattern.sub(lambda found: "\0" * len(found[0]), text)
    return _BOLD.sub(lambda found: "\0" * len(found[0]) if found[1].endswith(LEAD) else found[0], text)


def bold(text: str) -> list[str]:
    """Return what stands in bold in a text of Markdown and is no lead, as it is written, in its order."""
    return [" ".join(found[1].split()) for found in _BOLD.finditer(prose(text))]


def uses(text: str, entries: Iterable[Entry]) -> list[Use]:
    """Return where a text of Markdown uses words of the glossary, in its order; everyday words where they are bold."""
    known = by_form(entries)
    if not known:
        return []
    longest = sorted({form for entry in known.values() for form in entry.forms}, key=len, reverse=True)
    words = "|".join(r"\s+".join(map(re.escape, form.split())) for form in longest)
    found = []
    for match in re.finditer(rf"(\*\*)?(?<![\w-])({words})(?![\w-])(?(1)\*\*)", prose(text), re.IGNORECASE):
        entry = known[normal(match[2])]
        if match[1] or not entry.everyday:
            found.append(Use(entry, match.start(), match.end(), bool(match[1])))
    return found


def first_uses(text: str, entries: Iterable[Entry]) -> list[Use]:
    """Return the use of each word that a text introduces it by: where it is bold, else the first, in order."""
    chosen: dict[str, Use] = {}
    for use in uses(text, entries):
        known = chosen.get(use.entry.name)
        if known is None or (use.bold and not known.bold):
            chosen[use.entry.name] = use
    return sorted(chosen.values(), key=lambda use: use.start)
