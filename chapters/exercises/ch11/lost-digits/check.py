"""Deviations of nine values, small and large, near each other and not, against numpy in float64."""

from __future__ import annotations

import numpy as np

import chapters
from tests.support.either import evaluate
from tools.exercises.checking import Given

CASES = {
    "between 0 and 1": (0.0, 1.0),
    "near 1,000 that differ by up to 0.1": (1000.0, 0.1),
    "near 50 that differ by up to 0.001": (50.0, 0.001),
    "near 60,000 that differ by up to 10": (60_000.0, 10.0),
}
COUNT = 200


def check(given: Given) -> None:
    """Random neighbourhoods of each kind, and then equal samples."""
    file = str(chapters.folder_of(given.which) / "taa" / "neighbourhood.glsl")
    names = [f"s{i}" for i in range(9)]
    body = (
        f"vec3 nine[9] = vec3[9]({', '.join(names)}); Neighbourhood n = gathered(nine, vec2(0.0)); "
        "deviation = n.deviation;"
    )
    for kind, (base, range_) in {**CASES, "that are equal": (1234.5, 0.0)}.items():
        samples = (base + range_ * np.random.default_rng(3).random((COUNT, 9, 3))).astype(np.float32)
        inputs = {name: samples[:, i] for i, name in enumerate(names)}
        found = evaluate(given.device, [file], body, inputs, {"deviation": "vec3"}, {"FILTER": 0})[
            "deviation"
        ]
        wanted = samples.astype(np.float64).std(axis=1)
        off = np.abs(found - wanted) / max(float(wanted.mean()), 1e-9)
        off = np.where(np.isfinite(off), off, np.inf)
        row, channel = np.unravel_index(int(off.argmax()), off.shape)
        given.need(
            off.max() < 0.02,
            f"Nine values {kind} have a deviation of {wanted[row, channel]:.4g}, and here it is "
            f"{found[row, channel]:.4g}.",
        )
