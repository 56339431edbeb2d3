"""Weights of frames, against histories of impulses: frame k shows 1 and all others 0."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.exercises.checking import Given

CASES = {
    "a single frame": [0.3],
    "equal frames": [1 / n for n in range(1, 33)],
    "an exponential average": [0.1] * 60,
    "a share of 0 at the end": [1.0, 0.5, 0.25, 0.0, 0.0],
    "a history that begins anew": [1.0, 0.5, 1.0, 0.5],
    "a view that has moved": [
        *([0.1] * 20),
        *(1 / (3 + j) for means in (8, 8, 32) for j in range(1, means + 1)),
    ],
    "random shares": np.random.default_rng(5).random(40).tolist(),
}
LONG = 100_000


def check(given: Given) -> None:
    """Seven sequences, none at all, and a long one."""
    module: Any = given.module("taa.ages")
    for name in ("weights_of", "frames_in"):
        given.need(callable(getattr(module, name, None)), f"taa/ages.py has no function {name} yet.")
    given.need(list(module.weights_of([])) == [], "Without a frame there is no weight.")
    given.need(module.frames_in([]) == 0.0, "Without a frame the history has the noise of 0 frames.")
    for case, shares in CASES.items():
        found = np.asarray(module.weights_of(list(shares)), np.float64)
        history = np.zeros(len(shares))  # of all impulses at once
        for number, share in enumerate(shares):
            shown = np.eye(len(shares))[number]
            history += (shown - history) * (share if number else 1.0)
        given.need(
            found.shape == history.shape, f"For {case} there are {len(shares)} weights, not {found.size}."
        )
        worst = int(np.abs(found - history).argmax())
        given.need(
            np.abs(found - history).max() < 1e-12,
            f"For {case} frame {worst + 1} of {len(shares)} has the weight {history[worst]:.5f}, and not "
            f"{found[worst]:.5f}.",
        )
        count = float(module.frames_in(list(shares)))
        wanted = 1 / float((history**2).sum())
        given.need(
            abs(count - wanted) < 1e-9 * wanted,
            f"The history of {case} has the noise of {wanted:.3f} frames, and not of {count:.3f}.",
        )
    count = float(module.frames_in([0.1] * LONG))
    given.need(
        abs(count - 19.0) < 1e-6,
        f"After {LONG:,} frames with a share of 0.1 it is 19 frames, and not {count:g}.",
    )
