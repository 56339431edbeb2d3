"""What the spatial filter makes of a box of fog, in light and in extinction."""

from __future__ import annotations

import numpy as np

from common.scene import FogBox, Medium
from tests.support.fog import FULL, SIZE, VIEW, foggy, records
from tests.support.shadows import point
from tests.twins import fog as twin
from tools.exercises.checking import Given

LAMP = point((-1.2, 3.0, 0.8), candela=60.0)
BOX = Medium(extinction=0.02, boxes=(FogBox((1.0, 0.8, 1.5), (0.8, 0.7, 0.9), 0.6),))


def check(given: Given) -> None:
    """Froxels with the filter, against those without it that are averaged here."""
    volumes = []
    for spatial in (False, True):
        knobs = {**FULL, "fog_spatial": spatial}
        with given.open(foggy(LAMP, medium=BOX), SIZE, ("color",), **knobs) as renderer:
            renderer.render(VIEW)
            volumes.append(records(renderer)[1])
    given.silent()
    wanted = twin.spatially_filtered(volumes[0])
    for name, channels in (("light", slice(0, 3)), ("extinction", slice(3, 4))):
        right, found = wanted[..., channels], volumes[1][..., channels]
        wrong = ~np.isclose(found, right, rtol=1e-4, atol=1e-9).all(axis=-1)
        for z, y, x in np.argwhere(wrong)[:1].tolist():
            given.need(
                False,
                f"In {wrong.sum()} of {wrong.size} froxels {name} is not the mean of its neighbours: in slice {z}, row "
                f"{y}, column {x} it is {found[z, y, x, 0]:.4g} in place of {right[z, y, x, 0]:.4g}.",
            )
