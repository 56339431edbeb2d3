"""Weights of two colours against their definition, and a view at rest whose frames are averaged."""

from __future__ import annotations

import numpy as np

import chapters
from tests.support.either import evaluate
from tests.support.taa import EVEN, SIZE, VIEW, court
from tests.twins import taa as twin
from tools.exercises.checking import Given

FRAMES = 48
PAIRS = {"equal": (0.5, 0.5), "nearly equal": (0.5, 0.45), "different": (0.2, 0.8), "far apart": (4.0, 0.0)}


def check(given: Given) -> None:
    """First the weights of the history, then how much is left of the noise of single frames."""
    file = str(chapters.folder_of(given.which) / "taa" / "weights.glsl")
    now, before = (
        np.repeat(np.array([pair[i] for pair in PAIRS.values()], np.float32)[:, None], 3, axis=1)
        for i in (0, 1)
    )
    body = "Neighbourhood n = Neighbourhood(now, now, now, vec3(0.0), now); found = weights(now, before, n, 0.1);"
    found = evaluate(
        given.device,
        [file],
        body,
        {"now": now, "before": before},
        {"found": "vec2"},
        {"WEIGHT": 3, "FILTER": 0},
    )
    weights = found["found"].astype(np.float64)
    weights /= weights.sum(axis=1, keepdims=True)
    for name, pair, (_, history) in zip(PAIRS, PAIRS.values(), weights, strict=True):
        wanted = float(twin.by_difference(*pair))
        given.need(
            abs(history - wanted) < 1e-3,
            f"Luminances of {pair[0]:g} now and {pair[1]:g} before are {name}: the history's weight is {wanted:.3f}, "
            f"and here it is {history:.3f}.",
        )
    with given.open(court(), SIZE, ("color_linear",), **{**EVEN, "taa_share": 1.0}) as renderer:
        alone = [renderer.render(VIEW).image("color_linear").astype(np.float64) for _ in range(4)]
    with given.open(court(), SIZE, ("color_linear",), **{**EVEN, "taa_weight": "difference"}) as renderer:
        for _ in range(FRAMES):
            last = renderer.render(VIEW).image("color_linear").astype(np.float64)
    given.silent()
    mean = np.mean(alone, axis=0)
    noise, left = (float(np.sqrt(np.mean((one - mean) ** 2))) for one in (alone[0], last))
    given.need(
        left < 0.5 * noise,
        f"After {FRAMES} frames of a view at rest {100 * left / noise:.0f} % of the error of one frame are left.",
    )
