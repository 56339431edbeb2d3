"""The sections of all chapters in their order, and the parts of the READMEs that belong to them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import chapters
from common.lessons import Section

HEADING = re.compile(r"^(#{1,6}) (.+)$")


@dataclass(frozen=True)
class Part:
    """A section of a chapter; `number` counts from 1, and the chapter has `count` of them."""

    chapter: int
    number: int
    count: int
    section: Section

    @property
    def key(self) -> str:
        """The name of the section in records: the chapter, and the heading of the README."""
        return f"{self.chapter}/{self.section.title}"

    @property
    def exercise(self) -> str:
        """The exercise in commands: "4 no-new-layout"."""
        return f"{self.chapter} {self.section.exercise}"

    @property
    def folder(self) -> Path:
        """The folder of the chapter."""
        return chapters.FOLDER / chapters.folder_name(self.chapter)


def parts(number: int) -> list[Part]:
    """Return the sections of a chapter."""
    sections = chapters.lesson(number).sections
    return [Part(number, i, len(sections), section) for i, section in enumerate(sections, 1)]


def all_parts() -> list[Part]:
    """Return the sections of all chapters."""
    return [part for number in chapters.available() for part in parts(number)]


def summary(part: Part) -> str:
    """Return the line under the heading of a section in the README: its time, command, files and exercise."""
    files = ", ".join(f"[`{name}`]({name})" for name in part.section.files)
    return (
        f"> **Section {part.number} of {part.count}, {part.section.minutes} minutes.** "
        f"Run `./strata {part.section.run}`. Read {files}. Solve [`{part.section.exercise}`](#exercises)."
    )


def cut(text: str, titles: list[str]) -> dict[str, list[str]]:
    """Return the lines of a README by section: from its heading to the next section or chapter heading ("## ").

    A title that is no heading of the text is missing from the result.
    """
    found: dict[str, list[str]] = {}
    current: list[str] | None = None
    code = False
    for line in text.splitlines():
        code ^= line.startswith("```")
        heading = None if code else HEADING.match(line)
        if heading and heading[2] in titles:
            current = found.setdefault(heading[2], [])
        elif heading and len(heading[1]) <= 2:
            current = None
        if current is not None:
            current.append(line)
    return found
