"""Sharpened light of black squares, of a lamp and of noise, against float64."""

from __future__ import annotations

import numpy as np

from tests.support.glowing import glowing
from tests.support.scenes import facing
from tests.twins import finish as twin
from tools.exercises.checking import Given

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""


def check(given: Given) -> None:
    """First that all is finite, then that nothing is negative, then each pixel."""
    rng = np.random.default_rng(2)
    picture = (10.0 ** rng.uniform(-2, 1, (24, 30, 1)) * rng.uniform(0.2, 1.0, (24, 30, 3))).astype(
        np.float32
    )
    picture[3:6, 3:6] = 0.0
    picture[12, 12] = 30_000.0
    found = {}
    for amount in (0.0, 1.0):
        with given.open(
            glowing(picture), (30, 24), ("color_linear",), ambient=0.0, sharpen=amount
        ) as renderer:
            found[amount] = renderer.render(facing(ev100=EV)).image("color_linear").astype(np.float64)
    given.silent()
    plain, sharp = found[0.0], found[1.0]
    bad = int((~np.isfinite(sharp)).any(axis=-1).sum())
    given.need(
        bad == 0, f"Of {picture[..., 0].size} pixels {bad} are not a number; 9 of the picture are black."
    )
    below = int((sharp < 0.0).any(axis=-1).sum())
    given.need(below == 0, f"{below} pixels have negative light.")
    wanted = np.minimum(twin.sharpened(plain, 1.0), 65504.0)
    wrong = ~np.isclose(sharp, wanted, rtol=1e-4, atol=1e-7).all(axis=-1)
    for y, x in np.argwhere(wrong)[:1].tolist():
        given.need(
            False,
            f"{wrong.sum()} pixels are not sharpened as they should be: in row {y}, column {x} green is "
            f"{sharp[y, x, 1]:.4g} in place of {wanted[y, x, 1]:.4g}.",
        )
