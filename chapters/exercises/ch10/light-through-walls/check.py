"""Light of froxels that a cube hides from a lamp, by rays that are cast against the cube."""

from __future__ import annotations

import numpy as np

from tests.support.fog import FULL, SIZE, VIEW, foggy, grid_of, records
from tests.support.shadows import point
from tests.twins import fog as twin
from tools.exercises.checking import Given

LAMP = point((-1.2, 3.0, 0.8), candela=60.0)


def check(given: Given) -> None:
    """First that hidden froxels are dark, then that others have the light that they have without shadows."""
    scene, volumes = foggy(LAMP), []
    for shadows in ("on", "off"):
        with given.open(scene, SIZE, ("color",), **{**FULL, "shadows": shadows}) as renderer:
            renderer.render(VIEW)
            grid, volume = grid_of(renderer), records(renderer)[1]
        volumes.append(volume[..., :3])
    given.silent()
    dark, lit = volumes
    points, lamp = grid.samples(), np.array(LAMP[1][:3, 3])

    def crossed(half: float) -> np.ndarray:
        first, last = twin.crossing(points, lamp - points, twin.Box((0.0, 1.0, 0.0), (half,) * 3, 1.0))
        return np.asarray(last > first)

    hidden, near = crossed(0.45), crossed(0.55)
    sure = (hidden == near) & (points[..., 1] > 0.1) & (np.abs(points[..., [0, 2]]) < 3.8).all(axis=-1)
    behind = hidden & sure
    bright = behind & (dark.max(axis=-1) > 0.0)
    given.need(
        not bright.any(),
        f"{bright.sum()} of {behind.sum()} froxels behind the cube have light of a lamp that they cannot see.",
    )
    open_ = sure & ~hidden
    wrong = open_ & ~np.isclose(dark, lit, rtol=1e-4).all(axis=-1)
    given.need(
        not wrong.any(),
        f"{wrong.sum()} of {open_.sum()} froxels that the lamp sees have another light than without shadows.",
    )
