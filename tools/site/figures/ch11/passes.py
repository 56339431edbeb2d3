"""The passes behind lighting, what each reads besides the picture, and what it works on."""

from __future__ import annotations

from tools.site.figures.canvas import Canvas

ROWS = (
    ("motion, motion_objects", "the way of each pixel", "depth, two cameras", "a"),
    ("taa", "frame and history become one", "motion, depth, history", "a"),
    ("lens, exposure, bloom", "of earlier chapters", "", "card"),
    ("motion_blur", "light along the way", "motion", "b"),
    ("sharpen", "away from the mean of 3x3", "", "b"),
    ("tonemap", "tone curve, sRGB code", "", "c"),
    ("fxaa", "edges by their contrast", "", "c"),
)
"""Of each step: its passes, what it does, what it reads besides the picture, and its colour."""
WORKS = (("history", "a", 0, 2), ("linear light", "b", 2, 5), ("codes of the picture", "c", 5, 7))
"""What stands on the right: words, colour, first row, and the row behind the last."""
TALL = 50.0


def passes_behind_lighting() -> Canvas:
    """A row for each step from top to bottom."""
    c = Canvas(
        760,
        72 + TALL * len(ROWS),
        "The passes behind lighting: motion, the history, the lens, motion blur, sharpening, the tone curve and FXAA",
    )
    for x, words in ((20.0, "reads besides"), (236.0, "pass"), (556.0, "works on")):
        c.text(x, 26, words, 13, bold=True)
    for number, (name, does, more, fill) in enumerate(ROWS):
        y = 40 + TALL * number
        if more:
            c.box(20, y + 4, 180, 30, more, "d", 12)
            c.arrow(200, y + 19, 234, y + 19)
        c.box(236, y, 270, 38, f"{name}\n{does}", fill, 12)
        if number:
            c.arrow(371, y - TALL + 38, 371, y - 1)
    for words, fill, first, last in WORKS:
        y = 40 + TALL * first
        c.box(556, y, 180, TALL * (last - first) - 12, words, fill, 12)
    c.note(20, 62 + TALL * len(ROWS), "the last pass that is in the frame also dithers and splits the view")
    return c
