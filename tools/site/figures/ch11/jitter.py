"""Eight shifts of each sequence within a pixel, and their means before those are subtracted."""

from __future__ import annotations

import numpy as np

from chapters.ch11.taa.jitter import SEQUENCES, offsets, raw
from tools.site.figures.canvas import Canvas

PERIOD = 8


def means() -> dict[str, tuple[float, float]]:
    """Return the mean of each sequence's period, in pixels from the middle of a pixel."""
    found = {name: raw(name, np.arange(PERIOD), PERIOD).mean(axis=0) - 0.5 for name in SEQUENCES}
    return {name: (float(x), float(y)) for name, (x, y) in found.items()}


def sequences_in_a_pixel() -> Canvas:
    """A pixel for each sequence, with its shifts in their order."""
    c = Canvas(
        760,
        268,
        "Eight shifts of each of four sequences within a pixel, with their means before those are subtracted",
    )
    edge, top = 152.0, 46.0
    for number, name in enumerate(SEQUENCES):
        left = 24.0 + 184 * number
        c.text(left, 28, name, 13, bold=True)
        c.rectangle((left, top, edge, edge), "card", "line", False, 0)
        middle = left + edge / 2, top + edge / 2
        for x, y in ((9.0, 0.0), (0.0, 9.0)):
            c.line([(middle[0] - x, middle[1] - y), (middle[0] + x, middle[1] + y)], "ink", 1.5)
        for frame, (x, y) in enumerate(offsets(name, PERIOD)):
            at = middle[0] + edge * x, middle[1] + edge * y
            c.circle(*at, 4, "s1", "s1")
            c.text(at[0] + 6, at[1] + 4, str(frame), 10)
        x, y = means()[name]
        c.circle(middle[0] + edge * x, middle[1] + edge * y, 6, "paper", "mark")
        c.text(left, top + edge + 20, f"mean ({x + 0.0:.3f}, {y + 0.0:.3f})", 11, role="soft")
    c.note(
        24,
        252,
        "ring: the mean of the points as the source gives them, in pixels; dots: after it was subtracted",
    )
    return c
