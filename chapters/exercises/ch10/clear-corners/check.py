"""Transmittance of a constant medium where each froxel begins, by the law of Beer and Lambert."""

from __future__ import annotations

import numpy as np

from common.scene import Medium
from tests.support.fog import FULL, SIZE, VIEW, foggy, grid_of, records
from tools.exercises.checking import Given

EXTINCTION = 0.2


def check(given: Given) -> None:
    """Columns from the middle of the picture to its corners."""
    with given.open(foggy(medium=Medium(EXTINCTION)), SIZE, ("color",), **FULL) as renderer:
        renderer.render(VIEW)
        found = records(renderer)[0][..., 3]
        grid = grid_of(renderer)
    given.silent()
    uv = grid.centers()[0, ..., :2]
    metres = grid.edges()[:-1, None, None] * grid.stretch(uv)
    off = np.abs(found - np.exp(-EXTINCTION * metres))
    z, y, x = np.unravel_index(int(off.argmax()), off.shape)
    given.need(
        off.max() < 1e-4,
        f"In column {x}, row {y} slice {z} begins {metres[z, y, x]:.2f} m away along the ray, where "
        f"{100 * np.exp(-EXTINCTION * metres[z, y, x]):.1f} % of the light are left, and the record has "
        f"{100 * found[z, y, x]:.1f} %.",
    )
