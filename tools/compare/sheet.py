"""The picture that `strata compare` writes: A, B and the error map side by side, with labels and the map's scale."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from common.reports import metrics

Bytes = NDArray[np.uint8]
_Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

MARGIN = 16
HEADER = 58
"""Rows above the pictures: a title and a line below it."""
FOOTER = 44
"""Rows below the pictures: the scale of the map."""
LINE = 22
SMALLEST_PANEL = 360
"""Smaller pictures are magnified by a whole number, so that single pixels can be seen and labels have room."""
PAPER, INK, PALE = (24, 24, 28), (240, 240, 240), (165, 165, 175)
TITLE_PX, TEXT_PX = 18, 14


@dataclass(frozen=True, eq=False)
class Panel:
    """One picture (H, W, 3) uint8 with its title and a line of explanation."""

    title: str
    note: str
    pixels: Bytes


def heat(values: NDArray[np.float32], limit: float) -> Bytes:
    """Return (H, W, 3) the colours of numbers from 0 (black) to `limit` (cream); what is not finite is green."""
    return metrics.error_map(values, np.zeros_like(values), limit)


def magnification(size: tuple[int, int]) -> int:
    """Return by how much pictures of `size` are magnified."""
    return -(-SMALLEST_PANEL // max(size))


def origin(index: int, size: tuple[int, int]) -> tuple[int, int]:
    """Return (x, y) of the upper left corner of picture `index` on the sheet."""
    return MARGIN + index * (_panel_width(size) + MARGIN), MARGIN + HEADER


def sheet(panels: Sequence[Panel], limit: float, more: bool, texts: Sequence[str]) -> Bytes:
    """Return the sheet (H, W, 3): panels of one size, the last one's scale below it, and `texts` at the foot.

    The scale goes from 0 to `limit`; `more` says that some pixels lie above it.
    """
    height, width = panels[0].pixels.shape[:2]
    times, panel_width = magnification((width, height)), _panel_width((width, height))
    sheet_width = MARGIN + len(panels) * (panel_width + MARGIN)
    title, text = (ImageFont.load_default(size) for size in (TITLE_PX, TEXT_PX))
    lines = [line for one in texts for line in _wrapped(one, text, sheet_width - 2 * MARGIN)]
    below = MARGIN + HEADER + height * times
    page = Image.new("RGB", (sheet_width, below + FOOTER + LINE * len(lines) + MARGIN), PAPER)
    pen = ImageDraw.Draw(page)
    for index, panel in enumerate(panels):
        x, y = origin(index, (width, height))
        pen.text((x, MARGIN), _fitted(panel.title, title, panel_width), INK, title)
        pen.text((x, MARGIN + 28), _fitted(panel.note, text, panel_width), PALE, text)
        pixels = panel.pixels.repeat(times, axis=0).repeat(times, axis=1)
        page.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))
    _scale(page, pen, origin(len(panels) - 1, (width, height))[0], below + 8, panel_width, limit, more, text)
    for index, line in enumerate(lines):
        pen.text((MARGIN, below + FOOTER + index * LINE), line, PALE, text)
    return np.asarray(page)


def _scale(
    page: Image.Image,
    pen: ImageDraw.ImageDraw,
    x: int,
    y: int,
    width: int,
    limit: float,
    more: bool,
    font: _Font,
) -> None:
    """Draw the colours of 0 to `limit` with three numbers below them."""
    ramp = np.broadcast_to(np.linspace(0.0, limit, width, dtype=np.float32), (10, width))
    page.paste(Image.fromarray(heat(ramp, limit)), (x, y))
    pen.rectangle((x, y, x + width - 1, y + 9), outline=PALE)
    for part, anchor, end in ((0.0, "la", ""), (0.5, "ma", ""), (1.0, "ra", " and more" if more else "")):
        pen.text((x + part * (width - 1), y + 13), f"{part * limit:.3g}{end}", PALE, font, anchor=anchor)


def _panel_width(size: tuple[int, int]) -> int:
    """Return the width of a panel: that of its picture, or more for the labels of a narrow one."""
    return max(size[0] * magnification(size), SMALLEST_PANEL)


def _plain(text: str) -> str:
    """Return a text with what the font may lack replaced: a file's name can have any letter."""
    return text.encode("latin-1", "replace").decode("latin-1")


def _fitted(text: str, font: _Font, width: int) -> str:
    """Return a text that ends in "..." where it would be wider than `width` pixels."""
    text = _plain(text)
    if font.getlength(text) <= width:
        return text
    ends = range(len(text))
    fits = bisect(ends, width, key=lambda end: math.ceil(font.getlength(f"{text[:end]}...")))
    return f"{text[: max(fits - 1, 0)]}..."


def _wrapped(text: str, font: _Font, width: int) -> list[str]:
    """Return a text as lines that are at most `width` pixels wide, as far as its words allow."""
    lines: list[str] = []
    for word in _plain(text).split():
        if lines and font.getlength(f"{lines[-1]} {word}") <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return [_fitted(line, font, width) for line in lines]
