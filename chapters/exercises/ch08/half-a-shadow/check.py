"""Crates all around a lamp and below a sun: maps with and without the test of faces, and how much is drawn."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tests.support.shadows import all_faces, box, commanded, point, sun, yard
from tools.exercises.checking import Given

SIZE = (64, 48)
VIEW = View(pose_looking_at((0.0, 6.0, 7.0), (0.0, 0.0, 0.0)), Perspective(1.0, 0.05))


def check(given: Given) -> None:
    """Ten crates around the lamp, some of them over the edges of its faces."""
    extra = []
    for number in range(10):
        turn = 2 * np.pi * (number + 0.3) / 10
        extra += box((2.4 * float(np.cos(turn)), 0.2 + 0.17 * number, 2.4 * float(np.sin(turn))), 0.7)
    scene = yard(point((0.3, 2.6, 0.2)), sun((0.4, -1.0, 0.3)), extra=tuple(extra))
    maps, counts, pictures = [], [], []
    for on in (False, True):
        with given.open(
            scene,
            SIZE,
            ("color_linear",),
            graph="forward",
            geometry="compute",
            shadow_size=256,
            shadow_sun_size=256,
            shadow_cascades=2,
            shadow_cull_faces=on,
        ) as renderer:
            pictures.append(renderer.render(VIEW).image("color_linear").copy())
            maps.append(all_faces(renderer))
            culls = getattr(renderer.techniques["shadows"].passes["shadows"], "lists", None) is not None
            counts.append(sum(len(commands) for commands in commanded(renderer)) if culls else 0)
        given.silent()
    other = int((maps[0] != maps[1]).sum())
    pixels = int((pictures[0] != pictures[1]).any(axis=-1).sum())
    given.need(
        other == 0,
        f"{other} texels of the maps are not what they are with shadow_cull_faces=off, and {pixels} pixels of the "
        "picture: a face leaves out what it sees.",
    )
    given.need(
        counts[1] < counts[0] or counts[0] == 0,
        f"With the test of faces {counts[1]} commands are drawn, and without it {counts[0]}: it leaves out nothing.",
    )
