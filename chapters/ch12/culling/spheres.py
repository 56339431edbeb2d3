"""The spheres that the overlay shows: those of meshlets, and of the whole meshes that are drawn without any."""

from __future__ import annotations

import numpy as np

from ..meshlets.model import SceneMeshlets
from .lists import WHOLE, CullingLists

MOST_SPHERES = 8192
"""The most spheres that are shown: each takes 864 vertices, and more than these could not be told apart."""

SPHERE = np.dtype(
    [
        ("centre", np.float32, 3),
        ("radius", np.float32),
        ("extent", np.float32, 3),
        ("cone", np.uint32),
        ("instance", np.uint32),
        ("flags", np.uint32),
        ("unused", np.uint32, 2),
    ]
)
"""The record of a sphere (overlay.glsl): the bounds of a meshlet, its instance, and the flags of its draw."""


def sphere_records(
    lists: CullingLists, meshlets: SceneMeshlets | None, most: int = MOST_SPHERES
) -> np.ndarray:
    """Return (S,) SPHERE for the units of all draws; of more than `most` units, so many that are evenly spread."""
    draws = lists.draws
    ends = np.cumsum(draws["units"], dtype=np.int64)
    total = int(ends[-1]) if len(ends) else 0
    units = np.arange(total) if total <= most else np.arange(most) * total // most
    owner = np.searchsorted(ends, units, side="right")
    records = np.zeros(len(units), SPHERE)
    records["instance"], records["flags"] = draws["instance"][owner], draws["flags"][owner]
    cut = (records["flags"] & WHOLE) == 0
    if meshlets is not None:
        place = (draws["first_meshlet"] + draws["units"] - ends)[owner] + units
        chosen = meshlets.records[place[cut]]
        for name in ("centre", "radius", "extent", "cone"):
            records[name][cut] = chosen[name]
    return records
