"""A chapter over several pages: one for each section of the lesson, and some for what a reader looks up.

    chapters/ch04.md              what the chapter is about, and the list of its pages
    chapters/ch04-barriers.md     a section, with all that the README has until the next one
    chapters/ch04-exercises.md    parts of the README that are not read in one go; see `AROUND`

The README is one text, and its links name places in it. Here such a link, and an address from the time when a chapter
was one page, lead to the page that has the place now.
"""

from __future__ import annotations

import json
import posixpath
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html import escape

import chapters
from tools.lessons import sections
from tools.lessons.sections import HEADING, Part

AROUND = {
    "pictures": ("Pictures", ("Gallery", "One over the other", "The frame as a graph")),
    "studies": ("Studies", ()),
    "code": ("Code", ("Reading order", "What changed", "Lines that changed")),
    "try": ("Try it", ("Try it", "When it goes wrong")),
    "measured": ("Measured", ("Time and error", "Time against error", "What a frame does")),
    "exercises": ("Exercises", ("Exercises", "Further reading")),
}
"""The pages beside the sections: the end of the address, the title, and the headings of the parts that are there."""
STUDIES = re.compile(r"(The way in|Beside the way)\b")
"""How the headings of a chapter's studies begin."""
_LINK = re.compile(r'(\]\(|href=")([^()\s"#]*)#([^()\s"]+)')
_FENCE = re.compile(r"^(```.*?^```\s*$)", re.MULTILINE | re.DOTALL)
_ID = re.compile(r"\{[^{};]*#([\w-]+)[^{};]*\}")


@dataclass
class Split:
    """The pages of a chapter in their order, and for each place of the chapter as one page: (page, place there)."""

    pages: dict[str, str] = field(default_factory=dict)
    titles: dict[str, str] = field(default_factory=dict)
    places: dict[str, tuple[str, str]] = field(default_factory=dict)


def split(number: int, text: str) -> Split:
    """Return the pages of a chapter whose page would have this text."""
    parts = sections.parts(number) if number in chapters.available() else []
    front = f"chapters/{chapters.folder_name(number)}.md"
    names = {part.section.title: slug(part.section.title) for part in parts}
    titles = {name: title for title, name in names.items()} | {
        name: title for name, (title, _) in AROUND.items()
    }
    lines: dict[str, list[str]] = {"": [], **{name: [] for name in titles}}
    places: dict[str, tuple[str, str]] = {}
    whole: Counter[str] = Counter()
    alone = {name: Counter([slug(title)]) for name, title in titles.items()} | {"": Counter[str]()}
    current, raised = "", 0
    for line, heading in _lines(text):
        if heading is not None:
            level, title = heading
            current, raised = _page_of(level, title, names, current, raised)
            begins = current != "" and title == titles[current]
            place = slug(title) if begins else _unique(slug(title), alone[current])
            places[_unique(slug(title), whole)] = (current, place)
            if begins:
                continue  # the title of the page says it
            line = f"{'#' * max(level - raised, 2 if current else 1)} {line.lstrip('# ')}"
        for name in _ID.findall(line):
            places.setdefault(name, (current, name))
        lines[current].append(line)
    found = Split()
    address = {name: front.replace(".md", f"-{name}.md") if name else front for name in lines}
    kept = {name: "\n".join(body).strip() for name, body in lines.items()}
    for name, body in kept.items():
        if not name:
            found.pages[front] = body + "\n"
        elif body:
            found.titles[address[name]] = titles[name]
            head = titles[name] if name not in AROUND else f"Chapter {number}: {titles[name].lower()}"
            found.pages[address[name]] = f"# {head} {{ #{slug(titles[name])} }}\n\n{body}\n"
    found.places = {old: (address[name], place) for old, (name, place) in places.items()}
    found.pages[front] += _contents(parts, found, front)
    return found


def _lines(text: str) -> Iterator[tuple[str, tuple[int, str] | None]]:
    """Yield each line of a Markdown text, with the level and the words of a heading."""
    code = False
    for line in text.splitlines():
        code ^= line.startswith("```")
        found = None if code else HEADING.match(line)
        yield line, (len(found[1]), found[2]) if found else None


def _page_of(level: int, title: str, names: Mapping[str, str], current: str, raised: int) -> tuple[str, int]:
    """Return the page of a heading and by how many levels headings rise there, after those of the heading before."""
    if title in names:
        return names[title], level - 1
    if STUDIES.match(title):
        return "studies", level - 2
    if level <= 2:
        name = next((name for name, (_, heads) in AROUND.items() if title in heads), "")
        return name, 0
    if current == "studies" and level <= raised + 2:
        return "", 0  # what follows the studies in their part
    return current, raised


def _unique(place: str, taken: Counter[str]) -> str:
    """Return the name of a place on a page that has others of the same words: the second one ends in _1."""
    taken[place] += 1
    return f"{place}_{taken[place] - 1}" if taken[place] > 1 else place


def slug(words: str) -> str:
    """Return the name that Markdown's table of contents gives to a heading."""
    bare = re.sub(r"\[([^\]]*)\]\([^)]*\)(\{[^}]*\})?", r"\1", words)
    plain = unicodedata.normalize("NFKD", bare).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def _contents(parts: list[Part], found: Split, front: str) -> str:
    """Return the list of a chapter's pages, and where the places of the one page are that it once was."""
    addresses = {title: posixpath.basename(page) for page, title in found.titles.items()}
    rows = [
        f"| {part.number} | [{part.section.title}]({addresses[part.section.title]}) | {part.section.minutes} "
        f"| [{part.section.exercise}](#exercises) |"
        for part in parts
        if part.section.title in addresses
    ]
    text = (
        "\n## Sections\n\n| | section | minutes | exercise |\n|---:|---|---:|---|\n" + "\n".join(rows) + "\n"
        if rows
        else ""
    )
    others = [f"[{title}]({addresses[title]})" for title, _ in AROUND.values() if title in addresses]
    if others:
        text += f"\nOther pages of this chapter: {', '.join(others)}.\n"
    moved = {
        old: f"{posixpath.basename(page).replace('.md', '.html')}#{place}"
        for old, (page, place) in found.places.items()
        if page != front
    }
    return f'{text}\n<div hidden id="moved-places" data-places="{escape(json.dumps(moved))}"></div>\n'


def relinked(pages: Mapping[str, str], chapters_: Mapping[str, Split]) -> dict[str, str]:
    """Return pages whose links lead to the places of chapters, by their first pages, where they are now."""
    fronts = {page: front for front, made in chapters_.items() for page in made.pages}

    def link(found: re.Match[str], page: str) -> str:
        begin, where, place = found.groups()
        to = posixpath.normpath(posixpath.join(posixpath.dirname(page), where)) if where else page
        kind = ".html" if to.endswith(".html") else ".md"
        front = fronts.get(to.removesuffix(kind) + ".md")
        known = chapters_[front].places.get(place) if front else None
        if known is None:
            return found[0]
        at, name = known
        path = (
            "" if at == page else posixpath.relpath(at, posixpath.dirname(page) or ".").replace(".md", kind)
        )
        return f"{begin}{path}#{name}"

    made = {}
    for page, text in pages.items():
        split_up = _FENCE.split(text)
        split_up[::2] = [
            _LINK.sub(lambda found, page=page: link(found, page), part) for part in split_up[::2]
        ]
        made[page] = "".join(split_up)
    return made
