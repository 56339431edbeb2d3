"""Slices of depths, and the depths of samples, against a list of ends that is made slice by slice."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises.checking import Given

GRIDS = {
    "the default grid": (0.01, 2.0, 64),
    "a grid of one slice": (0.5, 3.0, 1),
    "12 slices": (0.1, 50.0, 12),
}


def check(given: Given) -> None:
    """Depths in front of near, within slices, beyond far and behind the eye; samples at five parts of each slice."""
    module: Any = given.module("fog.places")
    for name in ("slices_of", "depth_of"):
        given.need(callable(getattr(module, name, None)), f"fog/places.py has no function {name} yet.")
    for grid, (near, far, count) in GRIDS.items():
        ends = [near * (far / near) ** ((s + 1) / count) for s in range(count)]
        begins = [0.0, *ends[:-1]]
        depths = [
            -1.0,
            0.0,
            1e-9,
            near / 2,
            *(0.5 * (a + b) for a, b in zip(begins, ends, strict=True)),
            2 * far,
        ]
        wanted = [-1, -1, 0, 0, *range(count), count]
        found = np.asarray(module.slices_of(np.array(depths), near, far, count))
        given.need(
            found.shape == (len(depths),),
            f"slices_of gives the shape {found.shape} for {len(depths)} depths.",
        )
        for depth, right, number in zip(depths, wanted, found.tolist(), strict=True):
            given.need(
                number == right,
                f"In {grid} the depth {depth:g} lies in slice {right}, and the result is {number}.",
            )
        for index, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            for part in (0.0, 0.25, 0.5, 0.75, 1.0):
                right = part * end if index == 0 else begin * (end / begin) ** part
                depth = float(module.depth_of(index, part, near, far, count))
                given.need(
                    abs(depth - right) <= 1e-9 * far,
                    f"In {grid} the sample of slice {index} at the part {part:g} lies at {right:.6g}, and the "
                    f"result is {depth:.6g}.",
                )
