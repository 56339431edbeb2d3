"""The loop of chapter 12: a box by more and more paths. They find its lamp by chance (left), and by both ways."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import chapters
from chapters import scenes
from common.settings import preset, replaced
from tools.run.loops import GAP
from tools.site.figures.film import Loop, animated

CHAPTER, SCENE = 12, "cornell"
SIZE, RATE = (120, 120), 2.0
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 96, 128, 192, 256)
"""Paths through each pixel in the frames of the film."""
CAPTION = 22
"""Rows for the number of paths, below the pictures."""
STRATEGIES = ("bsdf", "mis")
QUALITY = 36

CONVERGES = Loop(
    "A box by 1 to 256 paths a pixel: they find the lamp by chance on the left, and by both ways on the right",
    "ch12-cornell.png",
    (2 * SIZE[0] + GAP, SIZE[1] + CAPTION),
    len(COUNTS),
    lambda c, n: None,
    RATE,
)
"""What a README says of the film, which has one file for both schemes."""


def converges() -> bytes:
    """Return the film. The frames of a side are sums of the same paths, of which there are ever more."""
    width, height = CONVERGES.size
    film = np.full((len(COUNTS), height, width, 3), 255, np.uint8)
    medium: Any = preset(chapters.settings_class(CHAPTER), "medium")
    for side, strategy in enumerate(STRATEGIES):
        settings = replaced(medium, path_tracer=True, path_strategy=strategy)
        left = side * (SIZE[0] + GAP)
        with chapters.open(
            CHAPTER, "auto", scene=scenes.load(SCENE), size=SIZE, settings=settings
        ) as renderer:
            view = chapters.view_of(renderer)
            for number, (before, count) in enumerate(zip((0, *COUNTS), COUNTS, strict=False)):
                renderer.settings.paths.path_samples = count - before
                codes = renderer.render(view).image("color")[..., :3]
                film[number, : SIZE[1], left : left + SIZE[0]] = codes
    frames = [Image.fromarray(one) for one in film]
    for frame, count in zip(frames, COUNTS, strict=True):
        words = "1 path a pixel" if count == 1 else f"{count} paths a pixel"
        ImageDraw.Draw(frame).text(
            (width / 2, height - 6), words, (40, 40, 40), ImageFont.load_default(13), "ms"
        )
    return animated(frames, RATE, QUALITY)
