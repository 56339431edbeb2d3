"""Masks of small pictures, against gradients that are computed pixel by pixel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tools.exercises.checking import Given

COARSE = 5


def check(given: Given) -> None:
    """Even pictures, edges, stripes, noise around the threshold, incomplete squares, and NaN."""
    function: Any = getattr(given.module("rates.picture"), "mask_of", None)
    given.need(callable(function), "rates/picture.py has no function mask_of yet.")
    for name, codes, texel in _pictures():
        wanted = _mask(codes, 0.1, texel)
        found = np.asarray(function(codes.copy(), 0.1, COARSE, texel))
        given.need(
            found.shape == wanted.shape,
            f"The mask of {name}, {codes.shape[1]}x{codes.shape[0]} pixels in squares of {texel}, is to have "
            f"{wanted.shape[1]}x{wanted.shape[0]} codes, and the result has the shape {found.shape}.",
        )
        for row, column in np.argwhere(found != wanted)[:1].tolist():
            given.need(
                False,
                f"In the mask of {name} the code in column {column} and row {row} is to be {wanted[row, column]}, and "
                f"it is {found[row, column]}.",
            )


def _pictures() -> Iterator[tuple[str, np.ndarray, int]]:
    random = np.random.default_rng(3)
    yield "an even picture", np.full((32, 48), 0.4), 16
    step = np.full((32, 48), 0.2)
    step[:, 16:] = 0.5
    yield "an edge between two squares", step, 16
    for name, part in (("upright", (slice(None), slice(None, None, 2))), ("level", (slice(None, None, 2),))):
        stripes = np.full((48, 48), 0.2)
        stripes[part] = 0.6  # in the middle square each pixel has equal neighbours on both sides
        yield f"{name} stripes of one pixel", stripes, 16
    yield "a ramp that ends at the edge of the picture", np.tile(np.linspace(0.1, 0.9, 30), (20, 1)), 8
    yield "a picture with incomplete squares", 0.03 * random.random((37, 51)) + step[0, 0], 16
    corner = np.full((37, 51), 0.2)
    corner[36, 50] = 0.9
    yield "a bright pixel in the last corner", corner, 16
    hole = np.full((32, 32), 0.2)
    hole[20, 20] = np.nan
    yield "a picture with a pixel that is no number", hole, 16
    for seed in range(4):
        smooth = np.cumsum(random.normal(0, 0.02, (40, 56)), axis=seed % 2)
        yield "noise", np.clip(0.5 + smooth, 0.0, 1.0), 8


def _mask(codes: np.ndarray, threshold: float, texel: int) -> np.ndarray:
    """Return the mask, by a loop over pixels and their neighbours."""
    height, width = codes.shape
    mask = np.full((-(-height // texel), -(-width // texel)), COARSE)

    def at(x: int, y: int) -> float:
        return float(codes[min(max(y, 0), height - 1), min(max(x, 0), width - 1)])

    for y in range(height):
        for x in range(width):
            across = down = 0.0
            for k, weight in ((-1, 1.0), (0, 2.0), (1, 1.0)):
                across += weight * (at(x - 1, y + k) - at(x + 1, y + k))
                down += weight * (at(x + k, y - 1) - at(x + k, y + 1))
            right, below = 4 * (at(x + 1, y) - at(x, y)), 4 * (at(x, y + 1) - at(x, y))
            found = [across**2 + down**2, right**2, below**2]
            if not all(value <= threshold for value in found):
                mask[y // texel, x // texel] = 0
    return mask
