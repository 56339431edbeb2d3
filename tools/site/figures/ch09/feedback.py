"""The mask over frames: stripes that fade in, by edges of the lit picture alone, and with turns; a loop of turns."""

from __future__ import annotations

from functools import cache

from tools.site.figures.canvas import Canvas, Point
from tools.site.figures.film import Loop, Picture

ALONG, DOWN, PERIOD = 3, 5, 8
"""Of the turn of a texel: (ALONG x + DOWN y + frame) modulo PERIOD is 0; rates/sobel.glsl has the same numbers."""
FRAMES, APPEARS = 12, 2
"""Frames of the figure, and the one in which the stripes appear."""
TEXELS = 8
WALL, SHOWN = (16, 8), 32
"""Texels and frames of the loop. The stripes appear on the right half of the wall."""
LATER = 4

COARSE, TURN, FINE = "coarse", "turn", "fine"
FILLS = {COARSE: "d", TURN: "b", FINE: "c"}
WORDS = {
    COARSE: "blocks of 2x2: the stripes give each block one light",
    TURN: "its turn: each pixel is lit, and edges are found if there are any",
    FINE: "each pixel is lit, since the last frame had edges here",
}


def has_its_turn(x: int, y: int, frame: int) -> bool:
    """Return whether a texel is lit in full in a frame, whatever its edges."""
    return (ALONG * x + DOWN * y + frame) % PERIOD == 0


def states(x: int, y: int, frames: int, appears: int | None, turns: bool = True) -> list[str]:
    """Return what a texel is in each frame; its stripes appear in a frame, or never."""
    found, edges = [], False
    for frame in range(frames):
        turn = turns and has_its_turn(x, y, frame)
        state = FINE if edges else TURN if turn else COARSE
        edges = state != COARSE and appears is not None and frame >= appears
        found.append(state)
    return found


def mask_over_frames() -> Canvas:
    """Eight texels of a row over twelve frames, twice."""
    c = Canvas(
        760,
        352,
        "Frames of a wall whose stripes fade in: by edges alone it stays coarse, with turns it is found and stays fine",
    )
    for left, turns, title in (
        (52.0, False, "edges of the lit picture alone"),
        (428.0, True, "with turns"),
    ):
        c.text(left, 26, title, 13, bold=True)
        _table(c, (left, 66.0), turns)
    c.text(46, 66 - 10, "frame", 12, "end", role="soft")
    for texel in range(TEXELS):
        c.text(
            46, 66 + 24 * texel + 17, f"texel {texel}" if not texel else str(texel), 11, "end", role="soft"
        )
    for number, (state, words) in enumerate(WORDS.items()):
        y = 282.0 + 22 * number
        c.rectangle((52, y, 16, 16), FILLS[state], "line", False, 0)
        c.note(78, y + 13, words)
    return c


def _table(c: Canvas, at: Point, turns: bool) -> None:
    """Draw the states of texels: a row for each, a column for each frame."""
    x, y = at
    side = 24.0
    for frame in range(FRAMES):
        c.text(x + side * (frame + 0.5), y - 10, str(frame), 12, "middle", role="soft")
    for texel in range(TEXELS):
        for frame, state in enumerate(states(texel, 0, FRAMES, APPEARS, turns)):
            place = x + side * frame, y + side * texel, side, side
            c.rectangle(place, FILLS[state], "line", False, 0)
    line = x + side * APPEARS
    c.line([(line, y - 4), (line, y + side * TEXELS + 6)], "mark", 2.5)
    c.text(line, y + side * TEXELS + 14, "stripes appear", 11, role="mark")


@cache
def wall() -> list[list[list[str]]]:
    """Return the state of each texel of the wall, by row, column and frame."""
    columns, rows = WALL
    return [
        [states(x, y, SHOWN, LATER if x >= columns // 2 else None) for x in range(columns)]
        for y in range(rows)
    ]


def turns(c: Picture, number: int) -> None:
    """The wall in one frame."""
    side = 38.0
    c.text(16, 24, f"frame {number}", 13, bold=True)
    words = "stripes on the right half" if number >= LATER else "an even wall"
    c.text(320, 24, words, 13, role="soft")
    for y, row in enumerate(wall()):
        for x, texel in enumerate(row):
            place = 16 + side * x, 38 + side * y, side, side
            c.rectangle(place, FILLS[texel[number]], "line", False, 0)
    for index, (state, word) in enumerate(zip(FILLS, ("blocks of 2x2", "its turn", "edges"), strict=True)):
        x0 = 16.0 + 200 * index
        c.rectangle((x0, 354, 16, 16), FILLS[state], "line", False, 0)
        c.note(x0 + 24, 367, word)


TURNS = {
    "ch09-turns-loop": Loop(
        "Turns go over a wall of texels; where stripes fade in, each texel stays fine from its turn on",
        "ch09-feedback.svg",
        (640, 384),
        SHOWN,
        turns,
        4.0,
    )
}
