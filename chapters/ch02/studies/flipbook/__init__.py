"""Study: animations from the layers of one texture. Each explosion shows its own frame, and one call draws them all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="flipbook",
    idea="A layer of an array texture is a coordinate: every instance of one draw can look at another picture.",
    order=1,
    features=("bindless/flipbook",),
)

FRAMES = 100
"""Pictures of a book: their numbers are 0 to 99, and at number 100 the animation is over."""

SIDE = 64
"""Texels of a picture, across and down."""

EVERY = 0.35
"""Seconds from the start of one explosion to that of the next."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    fps: float = knob(50.0, "pictures shown in a second", unit="1/s", minimum=10.0, maximum=1000.0)


@dataclass(frozen=True)
class Explosion:
    """An animation: when it begins (seconds), where its middle is (0 to 1, from the top left), its pixels across."""

    start: float
    x: float
    y: float
    side: float


RECORD = np.dtype([("place", np.float32, 4), ("frame", np.uint32), ("_padding", np.uint32, 3)])
"""An instance as the shader reads it, 32 bytes: x, y, width, height in pixels, and its picture's number."""

CAPACITY = 64
"""Explosions that can be seen at once: at 10 pictures a second one lasts 10 s, and 29 have begun by then."""

UNIFORM_BYTES = 16
SHADERS = ("studies/flipbook/quad.vert", "studies/flipbook/quad.frag")
SMOOTH = Sampler("linear", "linear", None, "clamp", "clamp")


def frame_at(start: float, fps: float, time: float) -> int | None:
    """Return the number of the picture that is shown at `time`; None before the first and after the last."""
    frame = math.floor(fps * (time - start))
    # "More than 100" would be wrong by one: picture 100 is the first of the next book, or no picture at all.
    return frame if 0 <= frame < FRAMES else None


def explosions(settings: Settings, size: tuple[int, int], time: float) -> list[Explosion]:
    """Return what may be burning at `time`, oldest first: one begins every 0.35 s, for ever.

    Places come from the number of the explosion alone. These two irrational steps leave no large gap in the unit square
    after any number of them (M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018).
    """
    newest = math.floor(time / EVERY)
    lasts = math.ceil(FRAMES / (settings.fps * EVERY))
    first = max(0, newest - lasts)
    return [
        Explosion(
            n * EVERY, 0.1 + 0.8 * (0.754877666 * n % 1), 0.1 + 0.8 * (0.569840291 * n % 1), 0.6 * size[1]
        )
        for n in range(first, newest + 1)
    ]


def records_of(
    burning: Sequence[Explosion], settings: Settings, size: tuple[int, int], time: float
) -> np.ndarray:
    """Return (N,) RECORD of the explosions that have a picture at `time`, in their order: later ones lie on top.

    A finished explosion must not be replaced by the last of the list: that changes which of two lies on top.
    """
    shown = [(explosion, frame_at(explosion.start, settings.fps, time)) for explosion in burning]
    alive = [(explosion, frame) for explosion, frame in shown if frame is not None]
    records = np.zeros(len(alive), RECORD)
    for record, (explosion, frame) in zip(records, alive, strict=True):
        corner = explosion.x * size[0] - explosion.side / 2, explosion.y * size[1] - explosion.side / 2
        record["place"], record["frame"] = (*corner, explosion.side, explosion.side), frame
    return records


def pictures() -> np.ndarray:
    """Return the book, (100, 64, 64, 4) uint8: a burst that grows, tears and goes out; alpha is its cover.

    Its rim is a circle with lobes, whose number and phases are constants. Behind it a hole opens, and colours cool down
    from white over yellow and red to smoke.
    """
    age = ((np.arange(FRAMES) + 0.5) / FRAMES)[:, None, None]
    across = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    x, y = np.meshgrid(across, across)
    angle, radius = np.arctan2(y, x), np.hypot(x, y)
    lobes = 0.12 * np.sin(7.0 * angle + 1.0) + 0.08 * np.sin(13.0 * angle + 4.0 * age)
    rim = (1.0 - (1.0 - age) ** 3) * (0.8 + lobes)
    hole = rim * (2.0 * age - 0.9)  # negative at first: there is none yet
    cover = np.clip((rim - radius) * 8.0, 0.0, 1.0) * np.clip((radius - hole) * 8.0, 0.0, 1.0)
    heat = np.clip(1.6 - 1.7 * age - 0.7 * radius / np.maximum(rim, 1e-3), 0.0, 1.0)
    smoke = 0.25 * (1.0 - heat)
    colors = np.stack([np.clip(k * heat + smoke, 0.0, 1.0) for k in (2.2, 1.3, 0.6)], axis=-1)
    alpha = cover * np.minimum(1.0, 3.0 * (1.0 - age))
    return np.rint(255.0 * np.concatenate([colors, alpha[..., None]], axis=-1)).astype(np.uint8)
