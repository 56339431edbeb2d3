"""The lists of layers: counted, summed, filled as the layers arrive, sorted and composited."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas

Float64 = NDArray[np.float64]

ARRIVED = (
    (2, "A", 0.20, (0.9, 0.2, 0.1), 0.5),
    (0, "A", 0.22, (0.9, 0.2, 0.1), 0.5),
    (3, "B", 0.60, (0.1, 0.4, 0.9), 0.4),
    (2, "B", 0.55, (0.1, 0.4, 0.9), 0.4),
    (0, "C", 0.35, (0.2, 0.8, 0.2), 0.6),
    (5, "C", 0.40, (0.2, 0.8, 0.2), 0.6),
    (2, "C", 0.38, (0.2, 0.8, 0.2), 0.6),
    (5, "A", 0.25, (0.9, 0.2, 0.1), 0.5),
)
"""Layers in the order in which they arrive: pixel, name, depth (1 is near), linear colour, opacity."""
PIXELS, SHOWN = 6, 2
UNDER = (0.8, 0.8, 0.8)


def lists() -> tuple[list[int], list[int], list[int], list[int]]:
    """Return of each pixel its count, where its layers begin, where they end, and the layer at each place."""
    counts = [sum(one[0] == pixel for one in ARRIVED) for pixel in range(PIXELS)]
    begins = [sum(counts[:pixel]) for pixel in range(PIXELS)]
    words, places = [*begins], [-1] * len(ARRIVED)
    for number, (pixel, *_) in enumerate(ARRIVED):
        places[words[pixel]] = number  # atomicAdd returns the place, and the word moves on
        words[pixel] += 1
    return counts, begins, words, places


def composited() -> list[tuple[int, Float64]]:
    """Return the layers of the pixel that is shown, farthest first, each with the colour after it."""
    _, begins, ends, places = lists()
    own = sorted(places[begins[SHOWN] : ends[SHOWN]], key=lambda number: ARRIVED[number][2])
    color, found = np.array(UNDER), []
    for number in own:
        *_, layer, opacity = ARRIVED[number]
        color = np.array(layer) * opacity + color * (1 - opacity)
        found.append((number, color))
    return found


def _shade(color: Float64) -> str:
    codes = np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * one):02x}" for one in codes.tolist())


def lists_of_layers() -> Canvas:
    """Counts of pixels, their sums, the pool as it is filled, and one pixel's list, sorted and composited."""
    c = Canvas(
        760,
        366,
        "The lists of layers: counted, summed, filled as they arrive, sorted by depth and composited",
    )
    counts, begins, ends, places = lists()
    left, step = 190.0, 62.0
    fills = "abcdef"
    rows = ((30.0, "1. count the layers", counts), (78.0, "2. sum before each pixel", begins))
    for y, words, values in rows:
        c.text(12, y + 19, words)
        for pixel, value in enumerate(values):
            c.box(left + step * pixel, y, 52, 28, str(value), fills[pixel] if counts[pixel] else "paper")
    for pixel in range(PIXELS):
        c.text(left + step * pixel + 26, 22, f"pixel {pixel}", 11, "middle", "soft")
    c.note(left + step * PIXELS + 8, 97, f"together {sum(counts)}")
    c.text(12, 169, "3. fill as they arrive")
    for place, number in enumerate(places):
        pixel, name, depth, *_ = ARRIVED[number]
        c.box(left + step * place, 148, 52, 36, f"{name}\n{depth:.2f}", fills[pixel], 11)
        c.text(left + step * place + 26, 199, str(number + 1), 11, "middle", "soft")
    for pixel in range(PIXELS):
        if counts[pixel]:
            c.arrow(left + step * pixel + 26, 106, left + step * begins[pixel] + 26, 148)
    c.note(
        left,
        217,
        f"below: which one arrived when. Afterwards each word is an end: {', '.join(map(str, ends))}",
    )
    c.text(12, 258, f"4. sort pixel {SHOWN}")
    c.text(12, 316, "5. composite")
    c.rectangle((left, 298, 52, 28), "card", "line", False, 4)
    c.raw(f'<rect x="{left:g}" y="298" width="52" height="28" rx="4" fill="{_shade(np.array(UNDER))}"/>')
    c.text(left + 26, 342, "solid", 11, "middle", "soft")
    for place, (number, color) in enumerate(composited(), 1):
        _, name, depth, layer, opacity = ARRIVED[number]
        x = left + 104 * place
        c.box(x, 234, 52, 36, f"{name}\n{depth:.2f}", fills[SHOWN], 11)
        c.raw(
            f'<rect x="{x + 58:g}" y="244" width="16" height="16" rx="2" fill="{_shade(np.array(layer))}"/>'
        )
        c.text(x + 26, 285, f"opacity {opacity:g}", 11, "middle", "soft")
        c.arrow(x - 52, 312, x, 312)
        c.raw(f'<rect x="{x:g}" y="298" width="52" height="28" rx="4" fill="{_shade(color)}"/>')
        c.text(x + 26, 342, " ".join(f"{one:.2f}" for one in color), 11, "middle", "soft")
    c.note(12, 360, "1 is near (reversed depth): the smallest depth is the farthest layer, and comes first.")
    return c
