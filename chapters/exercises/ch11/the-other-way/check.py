"""A pan by whole pixels over a wall that glows: what was seen before is the same with a history and without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.glowing import glowing
from tests.support.scenes import facing, translated
from tools.exercises.checking import Given

SIZE = (40, 24)
PIXEL = 2.0 / SIZE[1]
"""Metres of the wall that a pixel shows."""
WAYS = {"to the right": (2, 0), "down": (0, -3), "to the left and up": (-1, 2)}


def check(given: Given) -> None:
    """One step of the camera in each direction, without jitter."""
    codes = np.random.default_rng(7).uniform(0.2, 1.0, (SIZE[1], SIZE[0], 3))
    scene, view = glowing(codes.astype(np.float32)), facing()
    knobs = {"taa": "simple", "jitter_period": 1, "mip_bias": 0.0, "ambient": 0.0}
    for way, (x, y) in WAYS.items():
        step = replace(view, world_from_view=view.world_from_view @ translated(x * PIXEL, y * PIXEL))
        found = {}
        for share in (0.2, 1.0):
            with given.open(scene, SIZE, ("color_linear",), taa_share=share, **knobs) as renderer:
                renderer.render(view)
                found[share] = renderer.render(step).image("color_linear").astype(np.float64)
        given.silent()
        seen = found[1.0] > 0.0  # beside the wall it is black
        apart = np.abs(found[0.2] - found[1.0])[2:-4, 4:-4]
        wrong = (apart > 0.02 * found[1.0].max()) & seen[2:-4, 4:-4]
        given.need(
            not wrong.any(),
            f"The camera pans {way} by whole pixels, and {100 * wrong.mean():.0f} % of the pixels that were seen "
            f"before have another colour than without a history.",
        )
