"""Where the lessons explain a knob: the part of a README that names it, or the section about its subject."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import chapters
from common.files.shader_files import shown_path
from common.settings import knobs
from tools.lessons.sections import HEADING

USING = re.compile(
    r"What you will see|What changed|When it goes wrong|Try it|Change a shader|Looking inside|Time and error"
    r"|Reading order|The other files|Exercises|Without an answer key|The way in|Beside the way|Further reading"
    r"|Before you start"
)
"""Parts that use knobs and do not explain them: they count where nothing else names the knob."""


@dataclass(frozen=True)
class Place:
    """A part of a README: its heading, and the line from 1 on which the knob is named, else that of the heading."""

    path: Path
    heading: str
    line: int

    @property
    def spoken(self) -> str:
        """The place in words."""
        return f'{shown_path(self.path)}, "{self.heading}"'


@cache
def place_of(number: int, name: str) -> Place | None:
    """Return where the lessons up to chapter `number` explain a knob; None if none does.

    That is the first part that names it, from the chapter on that brings the knob; else the section about its subject.
    """
    having = [n for n in chapters.available() if n <= number and name in knobs(chapters.settings_class(n))]
    word = re.compile(rf"`(--set )?{re.escape(name)}(=[^`]*)?`")
    named = [place for n in having for place, text in _lines(n) if word.search(text)]
    explained = [place for place in named if not USING.match(place.heading)]
    about = [place for n in having if (place := _about(n, name)) is not None]
    return next(iter([*explained, *about, *named]), None)


def _about(number: int, name: str) -> Place | None:
    """Return the section of a lesson whose files are of the knob's subject."""
    subject = knobs(chapters.settings_class(number))[name].path.partition(".")[0]
    for section in chapters.lesson(number).sections:
        if any(file.startswith(f"{subject}/") for file in section.files):
            return next((place for place, _ in _lines(number) if place.heading == section.title), None)
    return None


@cache
def _lines(number: int) -> list[tuple[Place, str]]:
    """Return the lines of a README with their places; headings of the first two levels and of sections count."""
    path = chapters.folder_of(number) / "README.md"
    titles = {section.title for section in chapters.lesson(number).sections}
    heading, code, found = "", False, []
    for line, text in enumerate(path.read_text("utf-8").splitlines() if path.is_file() else [], 1):
        code ^= text.startswith("```")
        head = None if code else HEADING.match(text)
        if head and (len(head[1]) <= 3 or head[2] in titles):
            heading = head[2]
        found.append((Place(path, heading, line), text))
    return found


def places_of(which: chapters.Which) -> dict[str, Place]:
    """Return where the lessons explain the knobs of a chapter or a fork; of a study's knobs its own text tells."""
    if isinstance(which, str):
        return {}
    number = which if isinstance(which, int) else which.lesson.number
    names = knobs(chapters.settings_class(which))
    return {name: place for name in names if (place := place_of(number, name)) is not None}
