"""The loop of chapter 7: the walk of a pixel through the words of its bin and of its tile."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from chapters.ch07.clusters.model import STEPS_LOG2
from tools.site.figures.ch07.lights import Bits, Light, depth_code, meets
from tools.site.figures.film import Loop, Picture

WORD = 32
STREET_LIGHTS, STREET_SEED = 128, 13
WALK_HOLD = 6
"""Frames that show a word before its first light, and the last frames."""


@cache
def street() -> tuple[Light, ...]:
    """Return lights over a street, in the order of depth."""
    random = np.random.default_rng(STREET_SEED)
    ahead = np.sort(random.uniform(2.0, 40.0, STREET_LIGHTS))
    x, y = random.uniform(-0.6, 0.6, STREET_LIGHTS) * ahead, random.uniform(-0.4, 0.4, STREET_LIGHTS) * ahead
    radius = random.uniform(1.0, 6.0, STREET_LIGHTS)
    return tuple(
        Light(*one) for one in zip(x.tolist(), y.tolist(), ahead.tolist(), radius.tolist(), strict=True)
    )


WALK_AHEAD, WALK_TILE = 20.0, (4, 3)


@dataclass(frozen=True)
class Step:
    """A moment of the walk: the word, the bit that is taken (None: the word is read), and the lights found so far."""

    word: int
    bit: int | None
    found: tuple[int, ...]


@cache
def walk_bits() -> tuple[Bits, Bits]:
    """Return the bits of the pixel's bin, and those of its tile, of the lights of the street."""
    code = depth_code(WALK_AHEAD, STEPS_LOG2)
    low, high = np.array([[depth_code(end, STEPS_LOG2) for end in light.interval] for light in street()]).T
    return (low <= code) & (code <= high), np.array([meets(light, *WALK_TILE) for light in street()])


@cache
def steps() -> tuple[Step, ...]:
    """Return the walk, frame by frame: from the word of the bin's first light to that of its last one."""
    in_bin, in_tile = walk_bits()
    places = np.flatnonzero(in_bin)
    film: list[Step] = []
    found: tuple[int, ...] = ()
    for word in range(int(places[0]) // WORD, int(places[-1]) // WORD + 1):
        film += [Step(word, None, found)] * WALK_HOLD
        bits = (in_bin & in_tile)[WORD * word : WORD * (word + 1)]
        for bit in np.flatnonzero(bits).tolist():
            found = (*found, WORD * word + bit)
            film += [Step(word, bit, found)] * 3
    return (*film, *[film[-1]] * WALK_HOLD)


def walk(c: Picture, number: int) -> None:
    """The words of the bin, the bits of one word, and the lights that were found."""
    step, (in_bin, in_tile) = steps()[number], walk_bits()
    places = np.flatnonzero(in_bin)
    words = STREET_LIGHTS // WORD
    c.text(12, 28, "words")
    for word in range(words):
        inside = places[0] // WORD <= word <= places[-1] // WORD
        fill = "b" if word == step.word else "card" if inside else "paper"
        label = f"{WORD * word} to {WORD * word + WORD - 1}"
        c.box(64 + 142 * word, 12, 132, 24, label, fill, 12, dashed=not inside)
    left, wide = 64.0, 17.4
    rows = (("bin", in_bin, "b"), ("tile", in_tile, "c"), ("both", in_bin & in_tile, "a"))
    for row, (name, all_bits, fill) in enumerate(rows):
        y = 58.0 + 30 * row
        c.text(12, y + 16, name, bold=row == 2)
        for bit in range(WORD):
            on, light = bool(all_bits[WORD * step.word + bit]), WORD * step.word + bit
            taken = row == 2 and light in step.found and bit != step.bit
            kind = "paper" if not on or taken else fill
            c.box(left + wide * bit, y, wide - 1, 22, "1" if on and not taken else "0", kind, 11, round=0)
    if step.bit is not None:
        x = left + wide * step.bit + (wide - 1) / 2
        c.arrow(x, 164, x, 142, "mark")
        c.text(min(x, 604), 178, f"light {step.found[-1]}", 12, "middle", "mark")
    c.text(12, 208, "found")
    for place, light in enumerate(step.found):
        c.box(64 + 40 * place, 192, 34, 24, str(light), "a", 12)
    c.box(left, 228, 560, 4, "", "paper", round=1)
    c.box(left, 228, 560 * (number + 1) / len(steps()), 4, "", "b", round=1)


WALK = {
    "ch07-walk-loop": Loop(
        "The walk of a pixel: bits of its bin and of its tile are joined word by word, and each bit left is a light",
        "ch07-tiles.svg",
        (640, 244),
        len(steps()),
        walk,
        6.0,
    )
}
"""The loop by name; its still is a figure of the lesson."""
