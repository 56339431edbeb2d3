"""Loops that a renderer draws: a scene along a camera path, as an animated WebP for a lesson.

A module of figures has a `Loop` with the words and the still of such a film, as `CLOTH` in tools/site/figures/loops.py,
and makes its bytes by one call of `recorded`.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from PIL import Image

import chapters
from chapters import scenes
from common.view.paths import Stage, parse_path
from tools.site.figures.film import animated

GAP, PAPER = 4, 255
"""Columns between pictures that are side by side, and their grey."""


def recorded(
    which: chapters.Which,
    scene: str,
    path: str,
    frames: int,
    per_second: float,
    size: tuple[int, int],
    settings: Sequence[Any] = (None,),
    camera: str | None = None,
    backend: str = "auto",
    time: float = 0.0,
    drawn: int = 1,
    back: bool = False,
    quality: int | None = 60,
) -> bytes:
    """Return an endless film of a scene of `scenes.load` along a path, as `strata run --path` records it.

    Each of `settings` has one renderer, None the defaults, whose pictures of `size` are side by side. `drawn` frames
    are drawn for each that is kept, at `drawn * per_second` a second: histories need steps as small as in a window.
    With `back` the film runs backwards from its last frame to the second, so that it has no jump. `quality` is that
    of `film.animated`.
    """
    loaded, way, kept = scenes.load(scene), parse_path(path), []
    rate = per_second * drawn
    with ExitStack() as stack:
        renderers = [
            stack.enter_context(
                chapters.open(which, backend, scene=loaded, size=size, settings=one, outputs={"color"})
            )
            for one in settings
        ]
        stage = Stage.of(loaded, chapters.view_of(renderers[0], camera, time), size)
        for index in range((frames - 1) * drawn + 1):
            view = way.view(stage, index, rate)
            made = [renderer.render(view, time + index / rate) for renderer in renderers]
            if index % drawn == 0:
                kept.append(_beside([one.image("color")[..., :3] for one in made]))
    return animated([*kept, *kept[-2:0:-1]] if back else kept, per_second, quality)


def _beside(pictures: Sequence[Any]) -> Image.Image:
    """Return pictures (H, W, 3) uint8 of one size side by side."""
    gap = np.full((pictures[0].shape[0], GAP, 3), PAPER, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)][1:]
    return Image.fromarray(np.concatenate(parts, axis=1))
