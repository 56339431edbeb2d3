"""What shows itself: pictures and tables, below a cell of a notebook, in the system's viewer, or in a file.

Jupyter, VS Code and Colab ask an object for `_repr_mimebundle_`, which is all that IPython's protocol wants: nothing is
imported for it.

    from tools.run.shown import compared, figures

    compared({"1 sample": before, "4 samples": after})  # two pictures and the map of their difference
    figures({"1 sample": before, "4 samples": after})   # time and work as a table
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.images import check_writable, encode_png
from common.paths import write_whole
from tools.cli.console import say

Value = TypeVar("Value", bound=float)

Bundle = dict[str, str]
"""What a notebook can choose from: content by its type, as "text/html"; a PNG is coded by base64."""

VIEWER_S = 3.0
"""A viewer's launcher that fails does so at once; one that runs for longer is the viewer itself."""

_display: ContextVar[Callable[[Any], None] | None] = ContextVar("display", default=None)

_viewers: list[subprocess.Popen[bytes]] = []
"""Viewers that this process is the parent of."""


# --- pictures ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as a screen shows it: `pixels` (H, W, 3) uint8 are codes of sRGB, row 0 on top.

    `caption` says what is seen, `name` is how its file is called where nobody gives another name. Raises UserError for
    an array that is no picture.
    """

    pixels: NDArray[np.uint8]
    caption: str = ""
    name: str = "picture"

    def __post_init__(self) -> None:
        found = self.pixels
        if (
            not isinstance(found, np.ndarray)
            or found.dtype != np.uint8
            or found.shape[2:] != (3,)
            or not found.size
        ):
            what = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
            raise UserError(
                f"{what} is no picture: give uint8 (H, W, 3), or let frame.picture(name) choose the colours."
            )

    def save(self, path: str | Path) -> None:
        """Write the picture as a .png, whole or not at all. Raises UserError for a path that cannot be written."""
        if Path(path).suffix.lower() != ".png":
            raise UserError(
                f"{path}: what is shown is written as .png; common.images.write_image writes light."
            )
        check_writable(Path(path))
        try:
            write_whole(Path(path), encode_png(self.pixels, srgb=True))
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None

    def show(self) -> None:
        """Show the picture below the notebook's cell, else in the system's viewer, and say where its file is.

        Where there is neither, the file is written all the same. It is in the folder for temporary files, one for each
        call, and stays until the system clears that folder: a viewer may still read it.
        """
        display = notebook_display()
        if display is not None:
            display(self)
            return
        path = _temporary_file(self.name)
        self.save(path)
        if open_viewer(path):
            say(f"strata: the picture is in {path}.")
        else:
            say(
                f"strata: there is no display here that opens a picture, so it is in {path}: copy that file, or "
                'write it where you want it by .save("picture.png").'
            )

    def html(self) -> str:
        """Return the picture and its caption as HTML that needs no other file."""
        code = b64encode(encode_png(self.pixels, srgb=True)).decode()
        height, width = self.pixels.shape[:2]
        return (
            f'<figure style="margin: 0"><img src="data:image/png;base64,{code}" alt="{escape(self.caption)}" '
            f'width="{width}" height="{height}" style="max-width: 100%; height: auto">'
            f"<figcaption>{escape(self.caption)}</figcaption></figure>"
        )

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        """The PNG is there beside the HTML for notebooks that become PDF or text."""
        code = b64encode(encode_png(self.pixels, srgb=True)).decode()
        return {"text/html": self.html(), "image/png": code, "text/plain": repr(self)}

    def __repr__(self) -> str:
        height, width = self.pixels.shape[:2]
        return f"<picture {width}x{height}{': ' if self.caption else ''}{self.caption}>"


@contextmanager
def displaying(display: Callable[[Any], None]) -> Iterator[None]:
    """Let `display` have what is shown meanwhile: for a program that runs notebooks itself."""
    token = _display.set(display)
    try:
        yield
    finally:
        _display.reset(token)


def notebook_display() -> Callable[[Any], None] | None:
    """Return what puts an object below the cell that runs, or None outside of a notebook, as in IPython's terminal."""
    chosen = _display.get()
    if chosen is not None:
        return chosen
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None and hasattr(ipython, "get_ipython") else None
    if shell is None or any(kind.__name__ == "TerminalInteractiveShell" for kind in type(shell).__mro__):
        return None
    display: Callable[[Any], None] = import_module("IPython.display").display
    return display


def open_viewer(path: Path) -> bool:
    """Open a file with the program that the system has for it, without waiting; return whether there is one."""
    if sys.platform == "win32":
        try:
            os.startfile(path)
        except OSError:
            return False
        return True
    if sys.platform != "darwin" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    command = "open" if sys.platform == "darwin" else "xdg-open"
    try:
        launched = subprocess.Popen(
            [command, str(path)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is meant for the program, not for the viewer
        )
    except OSError:
        return False
    try:
        return launched.wait(VIEWER_S) == 0
    except subprocess.TimeoutExpired:
        _viewers.append(launched)
        return True


def _temporary_file(name: str) -> Path:
    try:
        handle, path = tempfile.mkstemp(prefix=f"strata-{name}-", suffix=".png")
    except OSError as error:
        raise UserError(
            f"No picture can be written to the folder for temporary files ({error.strerror}): "
            'write it where you want it by .save("picture.png").'
        ) from None
    os.close(handle)
    return Path(path)


# --- tables -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Table:
    """Rows of text under a title; a column whose name begins with ">" is aligned to the right."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    def html(self) -> str:
        """Return the table as HTML; colours are those of the page around it."""

        def cell(tag: str, column: str, text: str) -> str:
            align = "right" if column.startswith(">") else "left"
            scope = ' scope="col"' if tag == "th" else ""
            return f'<{tag}{scope} style="text-align: {align}">{escape(text)}</{tag}>'

        heads = "".join(cell("th", column, column.removeprefix(">")) for column in self.columns)
        rows = "".join(
            f"<tr>{''.join(map(cell, ['td'] * len(row), self.columns, row))}</tr>" for row in self.rows
        )
        caption = f'<caption style="text-align: left">{escape(self.title)}</caption>'
        return f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        return {"text/html": self.html(), "text/plain": str(self)}

    def __str__(self) -> str:
        heads = tuple(column.removeprefix(">") for column in self.columns)
        widths = [max(map(len, cells)) for cells in zip(heads, *self.rows, strict=True)]

        def line(cells: Sequence[str]) -> str:
            parts = zip(self.columns, cells, widths, strict=True)
            return "  ".join(
                f"{text:{'>' if head[:1] == '>' else '<'}{width}}" for head, text, width in parts
            ).rstrip()

        return "\n".join([self.title, line(heads), *map(line, self.rows)])

    __repr__ = __str__


class Figures(dict[str, Value]):
    """Numbers by name, a dict like any other, that a notebook shows as a table."""

    def __init__(self, values: Mapping[str, Value], title: str, columns: tuple[str, str]) -> None:
        super().__init__(values)
        self.title, self.columns = title, columns

    def table(self) -> Table:
        """Return the numbers as a table; counters that are zero are left out."""
        rows = tuple(
            (spoken(name), number(value)) for name, value in self.items() if value or isinstance(value, float)
        )
        return Table(self.title, (self.columns[0], f">{self.columns[1]}"), rows)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        return {"text/html": self.table().html(), "text/plain": repr(self)}


def spoken(name: str) -> str:
    """Return a counter's name as words."""
    return name.replace("_", " ")


def number(value: float) -> str:
    """Return a count, or milliseconds to the microsecond."""
    return f"{value:.3f}" if isinstance(value, float) else f"{value:,}"


def figures(frames: Mapping[str, Any]) -> Table:
    """Return time and work of frames side by side, each below its name.

    Of the counters there are those that differ; of one frame alone, those that are not zero. Waits for the frames.
    """
    shown = list(_named(frames).values())
    times = [frame.timings for frame in shown]
    work = [frame.work for frame in shown]
    passes: list[str] = []
    for one in times:  # in the order of the frame, also where a later one has more
        place = 0
        for name in one:
            if name not in passes:
                passes.insert(place, name)
            place = passes.index(name) + 1
    rows = [
        (f"{name}, GPU ms", *("-" if name not in one else number(float(one[name])) for one in times))
        for name in passes
    ]
    rows.append(("all passes, GPU ms", *(number(float(sum(one.values()))) for one in times)))
    rows.append(("recording, CPU ms", *(number(float(frame.cpu_ms)) for frame in shown)))
    for name in dict.fromkeys(name for one in work for name in one):
        values = [one.get(name) for one in work]
        if len({*values}) > 1 or (len(values) == 1 and values[0]):
            rows.append(
                (f"work: {spoken(name)}", *("-" if value is None else number(value) for value in values))
            )
    return Table("Time and work of a frame", ("", *(f">{name}" for name in frames)), tuple(rows))


# --- comparing --------------------------------------------------------------------------------------------------------


def compared(pictures: Mapping[str, Any]) -> Picture:
    """Return two pictures side by side with the map of their difference, as `strata compare` draws them.

    Each is a Picture, a frame, or an array (H, W, 3) uint8, under its title; the second is held against the first.
    The map is FLIP's where that package is installed, else the largest difference of a channel. Raises UserError
    unless there are two pictures of one size.
    """
    from tools.compare.measure import Measured, errors
    from tools.compare.report import figures as errors_of
    from tools.compare.report import map_text, verdict
    from tools.compare.sheet import Panel, heat, sheet
    from tools.compare.sides import shown_values

    titles = list(_named(pictures))
    if len(titles) != 2:
        raise UserError(
            f"Two pictures are compared, not {len(titles)}: give {{title: picture, title: picture}}."
        )
    both = [picture_of(one) for one in pictures.values()]
    sizes = [f"{one.pixels.shape[1]}x{one.pixels.shape[0]}" for one in both]
    if sizes[0] != sizes[1]:
        raise UserError(f"{titles[0]} is {sizes[0]} and {titles[1]} is {sizes[1]}: draw both in one size.")
    side: Any = None  # who drew them matters to the tables of `strata compare` alone
    first, second = (Measured(side, shown_values(one.pixels), None) for one in both)
    found, error_map, _ = errors(first, second, 1.0)
    panels = [Panel(title, one.caption, one.pixels) for title, one in zip(titles, both, strict=True)]
    panels.append(Panel("Their difference", map_text(error_map), heat(error_map.values, error_map.limit)))
    text = "; ".join(
        f"{name.removeprefix('error: ')}: {value}" for name, value in errors_of(found) if value != "-"
    )
    drawn = sheet(panels, error_map.limit, error_map.more, [text])
    return Picture(drawn, f"{titles[0]} and {titles[1]}. {verdict(found)}", "compared")


def picture_of(shown: Any) -> Picture:
    """Return what a frame shows, a Picture as it is, or an array (H, W, 3) uint8 as one. Raises UserError."""
    if isinstance(shown, Picture):
        return shown
    found: Picture = shown.picture() if hasattr(shown, "picture") else Picture(shown)
    return found


def _named(given: Any) -> Mapping[str, Any]:
    """Return things by their titles; raise UserError for anything else."""
    if not isinstance(given, Mapping) or not given:
        raise UserError('Titles are missing: write {"before": frame, "after": other}.')
    return given
