"""Stacks of panes of one colour against a closed form, and panes in all directions against sorting in float64."""

from __future__ import annotations

import math

import numpy as np

from tests.support.panes import BEHIND, DISTANCE, panes, stack, tilted, view
from tests.twins.layers import Layers, U
from tools.exercises.checking import Given

COLOR = np.array((0.75, 0.5, 0.25))
STACKS = ((1, 0.5), (16, 0.25), (40, 1 / 16), (17, 0.25), (300, 1 / 128))
"""Panes one behind the other, and the opacity of each."""
RANDOM, SIZE = 110, (48, 32)


def check(given: Given) -> None:
    """What a stack lets through says how many layers were composited; random panes say whether their order is right."""
    for count, alpha in STACKS:
        colors = np.tile((*COLOR, alpha), (count, 1))
        picture = _drawn(given, stack(np.linspace(-1, 1, count)), colors, (9, 7))
        through, wanted = (picture[3, 4, 0] - COLOR[0]) / (BEHIND - COLOR[0]), (1 - alpha) ** count
        seen = math.log(min(max(through, 1e-6), 1.0)) / math.log(1 - alpha)
        panes_of = f"{count} panes, each of which lets" if count > 1 else "A pane that lets"
        given.need(
            abs(through - wanted) < 1e-4,
            f"{panes_of} {1 - alpha:.2%} of the light through, should let {wanted:.2%} through together, and in the "
            f"picture it is {through:.2%}, as of {abs(seen):.1f}.",
        )
        given.need(
            np.abs(picture - (COLOR * (1 - wanted) + BEHIND * wanted)).max() < _bound(count),
            f"{count} panes of one colour have another colour together, or not the same one at every pixel.",
        )
    matrices, colors = tilted(11, RANDOM)
    matrices[:, :2, :2] *= 1.5
    colors[:, 3] *= 0.25
    picture = _drawn(given, matrices, colors, SIZE)
    truth = Layers(matrices, colors, SIZE, DISTANCE)
    ordered = truth.sorted_over(BEHIND)
    wrong = np.abs(picture - ordered).max(axis=-1)
    wrong[truth.near_edge | truth.close | (wrong <= _bound(truth.count))] = 0.0
    y, x = np.unravel_index(wrong.argmax(), wrong.shape)
    given.need(
        not wrong.any(),
        f"Pixel ({x}, {y}) has {truth.count[y, x]} layers of different colours and is {_text(picture[y, x])}; sorted "
        f"layers give {_text(ordered[y, x])}.",
    )


def _drawn(given: Given, matrices: np.ndarray, colors: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the linear colour (H, W, 3) of panes in float64; the pool has room for all of their layers."""
    picture = given.draw(
        panes(matrices, colors),
        view(),
        size=size,
        transparency="lists",
        transparency_nodes=float(len(colors)),
        background=BEHIND,
    )
    return picture.astype(np.float64)


def _bound(count: np.ndarray | int) -> np.ndarray | float:
    """Return the error of composites of so many layers: four roundings for each, and two of the background."""
    return (4 * count + 2) * U


def _text(color: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in color) + ")"
