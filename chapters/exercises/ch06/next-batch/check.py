"""A town of several materials: task shaders test and draw the meshlets that the compute path selects."""

from __future__ import annotations

import numpy as np

from tests.support.towns import town, walk
from tools.exercises.checking import Given

SIZE = (96, 64)
COUNTED = ("meshlets_tested", "meshlets_drawn", "triangles_drawn")
MEANING = {
    "meshlets_tested": "meshlets are tested",
    "meshlets_drawn": "meshlets are drawn",
    "triangles_drawn": "triangles are drawn",
}


def check(given: Given) -> None:
    """The counters of two views, and how many pixels show another object."""
    scene, views = town(), walk()[:2]
    work, ids = {}, {}
    for geometry in ("compute", "mesh"):
        with given.open(scene, SIZE, ("instance_id",), culling="frustum", geometry=geometry) as renderer:
            frames = [renderer.render(view) for view in views]
            work[geometry] = [dict(frame.work) for frame in frames]
            ids[geometry] = frames[-1].image("instance_id").copy()
    given.silent()
    for compute, mesh in zip(work["compute"], work["mesh"], strict=True):
        for name in COUNTED:
            given.need(
                mesh[name] == compute[name],
                f"With mesh shaders {mesh[name]} {MEANING[name]}, and with the compute path {compute[name]}.",
            )
    other = float(np.mean(ids["compute"] != ids["mesh"]))
    given.need(other < 0.01, f"{other:.1%} of the pixels show another object than with the compute path.")
