"""Edges that are nearly level and nearly upright: how far their pixels are from the part that the edge covers."""

from __future__ import annotations

import numpy as np

from common.images.color import decode_srgb
from tests.support.glowing import glowing
from tests.support.scenes import facing
from tests.twins.finish import covered
from tools.exercises.checking import Given

SIDE, EV = 40, -0.2630344058337938
"""Pixels, and the EV100 of exposure 1: nits are picture values."""
DARK, BRIGHT = 60.0, 200.0
EDGES = {"nearly level": (0.125, 1.0), "nearly upright": (1.0, 0.125)}


def check(given: Given) -> None:
    """The mean error of codes along the edge has to fall to less than half."""
    for name, normal in EDGES.items():
        cover = covered(SIDE, SIDE, normal, 22.3)
        hard = np.where(cover >= 0.5, BRIGHT, DARK)
        right = DARK + (BRIGHT - DARK) * cover
        light = decode_srgb(np.repeat(hard[..., None], 3, axis=-1) / 255.0)
        with given.open(glowing(light.astype(np.float32)), (SIDE, SIDE), ambient=0.0, fxaa=True) as renderer:
            found = renderer.render(facing(ev100=EV)).image("color")[..., 1].astype(np.float64)
        given.silent()
        inner = (slice(10, -10), slice(10, -10))
        before, after = (float(np.abs(one - right)[inner].mean()) for one in (hard, found))
        given.need(
            after < 0.5 * before,
            f"An edge that is {name} keeps {100 * after / before:.0f} % of the error of its stairs.",
        )
