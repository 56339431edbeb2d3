"""The second loop of chapter 7: layers are counted, their places are summed, and each layer goes to its place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from tools.site.figures.ch07.layers import ARRIVED, PIXELS, SHOWN, composited, lists
from tools.site.figures.film import Loop, Picture

FREE = -1
PER_LAYER, HOLD = 3, 6
"""Frames that show a layer as it is filled in or sorted, and a finished step."""


@dataclass(frozen=True)
class Moment:
    """What the film shows at a time: the step, the words of the pixels, the pool, and the layers that are sorted."""

    step: str
    words: tuple[int, ...]
    pool: tuple[int, ...]
    layer: int | None
    """The layer that arrives, or that is taken out of the pool."""
    done: tuple[int, ...] = ()


@cache
def moments() -> tuple[Moment, ...]:
    """Return the film, frame by frame."""
    empty = (FREE,) * len(ARRIVED)
    words = [0] * PIXELS
    step = "1. count: each layer adds 1 to the word of its pixel"
    film = [Moment(step, tuple(words), empty, None)] * HOLD
    for number, (pixel, *_) in enumerate(ARRIVED):
        words[pixel] += 1
        film += [Moment(step, tuple(words), empty, number)] * 2
    step, before = "2. sum: each word becomes the number of layers before its pixel", 0
    for pixel, count in enumerate([*words]):
        words[pixel] = before
        before += count
        film += [Moment(step, tuple(words), empty, None)] * 2
    step, pool = "3. fill: an atomic add returns the place of a layer", [*empty]
    for number, (pixel, *_) in enumerate(ARRIVED):
        pool[words[pixel]] = number
        words[pixel] += 1
        film += [Moment(step, tuple(words), tuple(pool), number)] * PER_LAYER
    film += [Moment(step, tuple(words), tuple(pool), None)] * HOLD
    step = f"4. composite pixel {SHOWN}: the farthest layer first"
    done: tuple[int, ...] = ()
    for number, _ in composited():
        done = (*done, number)
        film += [Moment(step, tuple(words), tuple(pool), number, done)] * PER_LAYER
    return (*film, *[film[-1]] * HOLD)


def fill_lists(c: Picture, number: int) -> None:
    """The words of six pixels, the pool below them, the layer that arrives, and the layers of a pixel in order."""
    moment = moments()[number]
    fills = "abcdef"
    left, step = 112.0, 62.0
    c.text(12, 26, moment.step, 13, bold=True)
    c.text(12, 74, "words")
    c.text(12, 148, "pool")
    own = ARRIVED[moment.layer][0] if moment.layer is not None else None
    for pixel, word in enumerate(moment.words):
        x = left + step * pixel
        c.text(x + 26, 48, f"pixel {pixel}", 11, "middle", "mark" if pixel == own else "soft")
        c.box(x, 54, 52, 28, str(word), fills[pixel])
    for place, layer in enumerate(moment.pool):
        x = left + step * place
        if layer == FREE:
            c.box(x, 126, 52, 36, "", "paper", dashed=True)
        else:
            pixel, name, depth, *_ = ARRIVED[layer]
            c.box(x, 126, 52, 36, f"{name}\n{depth:.2f}", fills[pixel], 11)
        c.text(x + 26, 176, str(place), 11, "middle", "soft")
    if moment.layer is not None and own is not None:
        start = left + step * own + 26
        if moment.layer in moment.pool and not moment.done:
            c.arrow(start, 82, left + step * moment.pool.index(moment.layer) + 26, 126, "mark")
        elif not moment.done:
            c.arrow(start, 104, start, 82, "mark")
    c.text(12, 214, "in order")
    for place, layer in enumerate(moment.done):
        pixel, name, depth, *_ = ARRIVED[layer]
        x = left + step * (lists()[1][SHOWN] + place)
        c.box(x, 192, 52, 36, f"{name}\n{depth:.2f}", fills[pixel], 11)
    c.box(left, 240, step * len(ARRIVED) - 10, 4, "", "paper", round=1)
    c.box(left, 240, (step * len(ARRIVED) - 10) * (number + 1) / len(moments()), 4, "", "b", round=1)


FILL = {
    "ch07-fill-loop": Loop(
        "Lists of layers: words count and become sums, each layer goes to its place, and one list is put in order",
        "ch07-layers.svg",
        (640, 256),
        len(moments()),
        fill_lists,
        6.0,
    )
}
"""The loop by name; its still is a figure of the lesson."""
