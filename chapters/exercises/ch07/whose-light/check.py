"""Lights of pixels by the function, by the bits of a frame's lists, and by points that the lights reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.support.lamps import lit_town
from tests.support.light_lists import Lists
from tests.support.towns import walk
from tests.twins.light_lists import reaches, seen_at
from tools.exercises.checking import Given

SIZE = (123, 77)
CUTOFF = 0.001
"""The default of `light_cutoff`, in lux."""
DIRECTIONAL = 3


def check(given: Given) -> None:
    """A town under 100 lights: pixels at random distances, at the picture's edges, and nearer and farther than all."""
    function: Any = getattr(given.module("clusters.which"), "lights_of", None)
    given.need(callable(function), "clusters/which.py has no function lights_of yet.")
    scene, view = lit_town(100, directional=DIRECTIONAL), walk()[0]
    with given.open(scene, SIZE, ("color",)) as renderer:
        renderer.render(view).image("color")
        found = Lists(renderer)
    given.silent()

    def asked(pixel: tuple[int, int], depth: float) -> list[int]:
        answer = function(found.words.copy(), found.layout, pixel, depth)
        given.need(
            isinstance(answer, list) and all(isinstance(light, int) for light in answer),
            f"The result should be a list of int, and is {type(answer).__name__}.",
        )
        lights: list[int] = answer
        return lights

    random = np.random.default_rng(8)
    pixels = np.stack([random.integers(0, side, 400) for side in SIZE], axis=1)
    pixels[:4] = [(0, 0), (SIZE[0] - 1, 0), (0, SIZE[1] - 1), (SIZE[0] - 1, SIZE[1] - 1)]
    depths = np.exp(random.uniform(np.log(0.02), np.log(60.0), 400))
    depths[4:40:4], depths[5:40:4], depths[6:40:4] = 1e-7, 0.0, 1e9
    for (x, y), depth in zip(pixels.tolist(), depths.tolist(), strict=True):
        number = int(found.bin_of(np.array([depth]))[0])
        row, column = y >> found.layout.tile_log2, x >> found.layout.tile_log2
        places = np.flatnonzero(found.depths[number] & found.tiles[row, column])
        wanted, answer = found.order[places].tolist(), asked((x, y), depth)
        where = f"At pixel ({x}, {y}), {depth:.4g} m away,"
        missing = set(wanted) - set(answer)
        more = set(answer) - set(wanted)
        given.need(not missing, f"{where} light {min(missing, default=0)} is missing.")
        given.need(not more, f"{where} light {min(more, default=0)} is too much.")
        given.need(answer == wanted, f"{where} the lights are right, and not in the order of the shader.")
    for number, reach in enumerate(reaches(scene, CUTOFF), DIRECTIONAL):
        at, away = seen_at(reach.points(random, 30), view, SIZE)
        inside = ~np.isnan(at[:, 0])
        for pixel, depth in zip(at[inside].astype(int).tolist(), away[inside].tolist(), strict=True):
            given.need(
                number in asked(tuple(pixel), depth),
                f"Light {number} reaches a point {depth:.2f} m away at pixel {tuple(pixel)}, and is missing there.",
            )
