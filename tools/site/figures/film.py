"""Short loops: frames that are drawn like figures, as an animated WebP for each scheme of colours.

A reader who prefers no motion sees the still figure in place of the loop; see `markup`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageSequence

from tools.site.figures.canvas import DARK, LIGHT, Canvas, Point

LARGEST = 300_000
"""Bytes of a loop at most."""
FINER = 2
"""Pixels of the drawing for each pixel of the film, in each direction: its edges are smooth."""
SCHEMES: Mapping[str, Mapping[str, str]] = {"": LIGHT, "-dark": DARK}
"""The ends of the files' names, and their colours."""

Draw = Callable[[Any, Mapping[str, str]], None]


class Picture(Canvas):
    """A canvas of pixels: `image` returns what was drawn, in one scheme."""

    def __init__(self, width: int, height: int, title: str) -> None:
        super().__init__(width, height, title)
        self._drawn: list[Draw] = []

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: float = 13,
        anchor: str = "start",
        role: str = "ink",
        bold: bool = False,
    ) -> None:
        """Write one line, as on a canvas."""
        super().text(x, y, text, size, anchor, role, bold)
        place = {"start": "ls", "middle": "ms", "end": "rs"}[anchor]
        at = (x * FINER, y * FINER)
        self._drawn.append(lambda to, colors: to.text(at, text, colors[role], _font(size * FINER), place))

    def rectangle(
        self, place: tuple[float, float, float, float], fill: str, stroke: str, dashed: bool, round: float
    ) -> None:
        """Draw a rectangle: x, y, width and height."""
        x, y, width, height = (FINER * one for one in place)
        if width < 1:
            return
        line = 1 if dashed else FINER
        self._drawn.append(
            lambda to, colors: to.rounded_rectangle(
                (x, y, x + width, y + height),
                min(round * FINER, width / 2),
                colors[fill],
                colors[stroke],
                line,
            )
        )

    def circle(self, x: float, y: float, radius: float, fill: str = "card", stroke: str = "line") -> None:
        """Draw a disc."""
        box = tuple(FINER * one for one in (x - radius, y - radius, x + radius, y + radius))
        self._drawn.append(lambda to, colors: to.ellipse(box, colors[fill], colors[stroke], FINER))

    def line(
        self,
        points: Sequence[Point],
        role: str = "line",
        width: float = 1.5,
        dashed: bool = False,
        arrow: bool = False,
    ) -> None:
        """Draw a line through points, with a head at its end if it is an arrow."""
        places = [(FINER * x, FINER * y) for x, y in points]
        wide = max(1, math.ceil((width if not dashed else 1) * FINER))
        self._drawn.append(lambda to, colors: to.line(places, colors[role], wide, "curve"))
        if arrow:
            (x0, y0), (x, y) = points[-2], points[-1]
            self._head(x, y, math.atan2(y - y0, x - x0), role)

    def polygon(self, points: Sequence[Point], fill: str = "card", stroke: str = "line") -> None:
        """Draw a closed shape."""
        places = [(FINER * x, FINER * y) for x, y in points]
        self._drawn.append(lambda to, colors: to.polygon(places, colors[fill], colors[stroke]))

    def image(self, colors: Mapping[str, str]) -> Image.Image:
        """Return the picture in these colours, in RGB."""
        size = (int(self.width), int(self.height))
        large = Image.new("RGB", (size[0] * FINER, size[1] * FINER), colors["paper"])
        to = ImageDraw.Draw(large)
        for draw in self._drawn:
            draw(to, colors)
        return large.resize(size, Image.Resampling.BOX)


@cache
def _font(size: float) -> Any:
    return ImageFont.load_default(size)


@dataclass(frozen=True)
class Loop:
    """A loop: its size, how many frames, and what draws one of them on a picture, from its number.

    `still` is the file in docs/pictures that stands for it without motion; `words` say what it shows.
    """

    words: str
    still: str
    size: tuple[int, int]
    frames: int
    draw: Callable[[Picture, int], None]
    per_second: float = 10.0
    inputs: tuple[str, ...] = field(default=())

    def picture(self, number: int) -> Picture:
        """Return frame `number`."""
        made = Picture(*self.size, self.words)
        self.draw(made, number)
        return made

    def file(self, colors: Mapping[str, str]) -> bytes:
        """Return the loop in a scheme's colours."""
        return animated(
            [self.picture(number).image(colors) for number in range(self.frames)], self.per_second
        )


def animated(frames: Sequence[Image.Image], per_second: float, quality: int | None = None) -> bytes:
    """Return an endless WebP of RGB pictures: without loss, or with the quality (0 to 100) that is given."""
    to = io.BytesIO()
    how: dict[str, Any] = {"lossless": True, "quality": 70} if quality is None else {"quality": quality}
    frames[0].save(
        to,
        "WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 / per_second),
        loop=0,
        method=4,
        minimize_size=True,
        **how,
    )
    return to.getvalue()


def pictures_of(data: bytes) -> NDArray[np.uint8]:
    """Return the frames of an animated WebP, (N, H, W, 3)."""
    with Image.open(io.BytesIO(data)) as film:
        found = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    return np.stack(found)


def markup(name: str, loop: Loop, dark: bool = True) -> str:
    """Return what shows a loop in a README: the still picture for readers who prefer no motion.

    Without `dark` the loop has one file for both schemes.
    """
    at = "../../docs/pictures"
    source = f'<source media="(prefers-color-scheme: dark)" srcset="{at}/{name}-dark.webp">\n'
    return (
        "<picture>\n"
        f'<source media="(prefers-reduced-motion: reduce)" srcset="{at}/{loop.still}">\n'
        f"{source if dark else ''}"
        f'<img src="{at}/{name}.webp" width="{loop.size[0]}" alt="{loop.words}">\n'
        "</picture>"
    )
