"""The loop of chapter 11: a scene along a path, without a history beside the same with it."""

from __future__ import annotations

import chapters
from tools.site.figures.film import Loop
from tools.site.figures.recorded import GAP, recorded

CHAPTER, SCENE, PATH = 11, "market", "walk"
SIZE, FRAMES, RATE = (192, 108), 20, 12.0

WALK = Loop(
    "The market along a path, without a history on the left and with it on the right",
    "ch11-atrium.png",
    (2 * SIZE[0] + GAP, SIZE[1]),
    FRAMES,
    lambda c, n: None,
    RATE,
)
"""What a README says of the film, which has one file for both schemes."""


def walk() -> bytes:
    """Return the film; two frames are drawn for each one that is kept."""
    kind = chapters.settings_class(CHAPTER)
    both = (kind(), kind(taa="full"))
    return recorded(CHAPTER, SCENE, PATH, FRAMES, RATE, SIZE, both, drawn=2, back=True, quality=55)
