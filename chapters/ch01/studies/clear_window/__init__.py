"""Study: a picture of one colour, which changes with time. The smallest frame there is."""

import math

from common.lessons import Study

STUDY = Study(
    title="clear window",
    idea="A frame is a list of commands for one image: it is made ready, cleared, and handed on.",
    order=1,
)

PERIOD_S = 6.0
"""Seconds until the colour is the same again."""


def color_at(time: float) -> tuple[float, float, float, float]:
    """Return red, green, blue and alpha, 0 to 1: three waves, each a third of a period behind the one before."""
    turns = time / PERIOD_S % 1.0
    red, green, blue = (0.5 + 0.5 * math.cos(2 * math.pi * (turns - third / 3)) for third in range(3))
    return red, green, blue, 1.0
