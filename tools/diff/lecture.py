"""The lecture on a chapter: 10 to 15 stops with a title, a picture, lines of code and the speaker's notes.

Stops are written by hand, in `lecture.toml` of the chapter. Each names its lines by the text with which the first one
begins, so that an edit elsewhere in the file moves no stop.
"""

from __future__ import annotations

import base64
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.paths import ROOT
from tools.diff.files import Source

FILE = "lecture.toml"
PICTURES = ROOT / "docs" / "pictures"
FEWEST, MOST = 10, 15
"""Stops of a lecture."""


@dataclass(frozen=True)
class Stop:
    """One stop; `lines` of `file` begin at the only line that begins with `start`. Both are empty without code."""

    title: str
    notes: str
    file: str = ""
    start: str = ""
    lines: int = 0
    picture: str = ""


def stops_of(folder: Path) -> list[Stop]:
    """Return the stops of a chapter; raise UserError where it has no lecture, or one that cannot be read."""
    path = folder / FILE
    if not path.is_file():
        raise UserError(
            f"{folder.name} has no lecture: {path} is not there. Without --lecture there is the difference."
        )
    try:
        listed: list[dict[str, Any]] = tomllib.loads(path.read_text("utf-8"))["stops"]
        return [
            Stop(
                str(one["title"]),
                str(one["notes"]).strip(),
                str(one.get("file", "")),
                str(one.get("from", "")),
                int(one.get("lines", 0)),
                str(one.get("picture", "")),
            )
            for one in listed
        ]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{path} cannot be read: {error}.") from None


def first_line(stop: Stop, text: str) -> int:
    """Return the number of a stop's first line, from 0; raise UserError unless exactly one line begins so."""
    found = [number for number, line in enumerate(text.split("\n")) if line.startswith(stop.start)]
    if len(found) != 1:
        raise UserError(
            f"The stop {stop.title!r}: {len(found)} lines of {stop.file} begin with {stop.start!r}."
        )
    return found[0]


def themes() -> str:
    """Return the rules by which the figures follow the page's own switch between light and dark."""
    from tools.site.figures.canvas import DARK, LIGHT, variables

    return "".join(
        f":root[data-theme={name}] .strata-figure{{{variables(colors)}}}"
        for name, colors in (("light", LIGHT), ("dark", DARK))
    )


def picture_of(stop: Stop) -> str:
    """Return the picture of a stop as HTML, "" if it has none; raise UserError if its file is missing."""
    if not stop.picture:
        return ""
    path = PICTURES / stop.picture
    if not path.is_file():
        raise UserError(f"The stop {stop.title!r}: there is no picture {stop.picture} in docs/pictures.")
    if path.suffix == ".svg":
        return f'<div class="drawing">{path.read_text("utf-8").strip()}</div>'
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<div class="drawing"><img src="data:image/png;base64,{data}" alt="{escape(stop.title)}"></div>'


def lecture(
    stops: Sequence[Stop],
    read: Callable[[str], Source],
    highlighted: Callable[[Source], list[str]],
    added: Callable[[str], frozenset[int]],
) -> str:
    """Return the stops as HTML. `added` has the numbers, from 1, of the lines of a file that the chapter adds."""
    sections = []
    for number, stop in enumerate(stops, 1):
        code = ""
        if stop.file:
            source = read(stop.file)
            begin = first_line(stop, source.text or "")
            new = added(stop.file)
            rows = "".join(
                f'<div class="l{" add" if place in new else ""}"><span>{place}</span>'
                f'<span class="mark">{"+" if place in new else " "}</span><code>{line}</code></div>'
                for place, line in enumerate(highlighted(source)[begin : begin + stop.lines], begin + 1)
            )
            code = f'<p class="where">{escape(stop.file)}:{begin + 1}</p><div class="code">{rows}</div>'
        label = escape(f"stop {number}, {stop.title}")
        sections.append(
            f'<section><h2>{number}. {escape(stop.title)}</h2><div class="step" tabindex="0" aria-label="{label}">'
            f'{picture_of(stop)}{code}<p class="notes">{escape(stop.notes)}</p></div></section>'
        )
    return f'<main id="lecture" aria-label="Lecture">{"".join(sections)}</main>'
