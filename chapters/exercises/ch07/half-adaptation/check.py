"""The exposure of frames after the light changed: at each of them its place on the way, and at the end its target."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from common.settings import knobs
from tests.support.glowing import exposure_of, glow_of
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given

RATE = 60
"""Frames in a second."""
NEAR = 0.01


class Walk(NamedTuple):
    """The light of a scene in nits, and the seconds for which it stays so."""

    mode: str
    start: float
    then: tuple[tuple[float, float], ...]
    knobs: tuple[tuple[str, Any], ...] = ()


WALKS = (
    Walk("histogram", 2.0, ((700.0, 2.5), (90.0, 7.5))),
    Walk("mips", 1300.0, ((1030.0, 4.5), (1270.0, 4.5)), (("adapt_speed", 0.05),)),
    Walk("mips", 120_000.0, ((100_000.0, 2.5),)),
)


def check(given: Given) -> None:
    """Both ways to measure; brighter and darker; light that is within what a half holds, and beyond."""
    for walk in WALKS:
        found = _exposures(given, walk)
        wanted, before, first = _wanted(given, walk), walk.start, 0
        for nits, seconds in walk.then:
            last = first + round(seconds * RATE)
            off = found[first:last] / wanted[first:last] - 1.0
            sound = np.isfinite(off) & (off > -1.0)
            after = f"With exposure={walk.mode} and {RATE} frames in a second, {{:.2f}} s after the light went from "
            after += f"{before:g} to {nits:g} nits"
            rests = "has come to rest" if found[last - 1] == found[last - 2] else "still moves"
            frame = int(np.argmin(sound))
            given.need(
                sound.all(),
                f"{after.format(frame / RATE)} the exposure is {found[first + frame]:g}: is luminance more than its "
                "state can hold?",
            )
            given.need(
                abs(off[-1]) <= NEAR,
                f"{after.format(seconds)} the exposure {rests} at {found[last - 1]:.3g}: {abs(off[-1]):.1%} from its "
                "target.",
            )
            frame = int(np.argmax(np.abs(off) > NEAR))
            given.need(
                np.abs(off).max() <= NEAR,
                f"{after.format(frame / RATE)} the exposure is {found[first + frame]:.3g}, and should be "
                f"{wanted[first + frame]:.3g} on its way.",
            )
            before, first = nits, last


def _exposures(given: Given, walk: Walk) -> np.ndarray:
    """Return the exposure of each frame after the first change of light."""
    scene, found = quad_scene(glow_of(walk.start)), []
    lights = [walk.start] * 2 + [nits for nits, seconds in walk.then for _ in range(round(seconds * RATE))]
    dim = facing(ev100=math.log2(walk.start) + 1.0)
    with given.open(scene, (8, 8), ambient=0.0, exposure=walk.mode, **dict(walk.knobs)) as renderer:
        for number, nits in enumerate(lights):
            if number and nits != lights[number - 1]:
                with scene.edit() as edit:
                    edit.set_material(0, glow_of(nits))
            found.append(exposure_of(renderer, renderer.render(dim, number / RATE)))
    given.silent()
    return np.array(found[2:])


def _wanted(given: Given, walk: Walk) -> np.ndarray:
    """Return the same in double precision: a frame shows what those before it measured."""
    known = knobs(type(given.settings()))
    value = {**{name: one.default for name, one in known.items()}, **dict(walk.knobs)}
    key, nits, path = value["exposure_key"], walk.start, []
    stops = math.log2(key / nits)
    for level, seconds in walk.then:
        for _ in range(round(seconds * RATE)):
            path.append(2.0**stops if walk.mode == "histogram" else key / nits)
            target = math.log2(key / level)
            tau = value["adapt_dark_s"] if target > stops else value["adapt_bright_s"]
            stops = target + (stops - target) * math.exp(-1.0 / RATE / tau)
            nits = level + (nits - level) * 0.98 ** (value["adapt_speed"] * 1e3 / RATE)
    return np.array(path)
