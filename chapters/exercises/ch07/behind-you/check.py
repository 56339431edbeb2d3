"""Lamps around the eye, before it and behind it: the tiles that they reach, and the picture against brute force."""

from __future__ import annotations

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Light, Scene
from common.view.camera import Perspective, View
from tests.support.lamps import lamps, lit
from tests.support.light_lists import Lists
from tests.support.towns import town
from tests.twins.light_lists import built
from tools.exercises.checking import Given

SIZE = (61, 35)
CUTOFF = 0.001
"""The default of `light_cutoff`, in lux."""
VIEW = View(pose_looking_at((-9.0, 1.2, 8.0), (1.0, 0.5, -2.0)), Perspective(0.9, 0.05))
PLACES = [
    (where, offset, reach)
    for reach in (0.5, 3.0, 8.0)
    for where, offset in (
        ("behind", (0.0, 0.0, 1.0)),
        ("beside", (2.0, 0.0, 0.0)),
        ("above", (0.0, 2.0, 0.5)),
        ("in front of", (0.0, 0.0, -2.0)),
        ("at", (0.0, 0.0, 0.0)),
        ("behind", (1.0, 0.0, 5.0)),
    )
]
"""Lamps: where they are, their offset from the eye (right, up, back), and their range in metres."""


def check(given: Given) -> None:
    """Lamps whose light has the eye in it, and others; and lamps of all kinds between them."""
    scene = _scene()
    with given.open(scene, SIZE, ("color_linear",), light_lists="tiles", graph="deferred") as renderer:
        picture = renderer.render(VIEW).image("color_linear").copy()
        found = Lists(renderer)
    given.silent()
    least, most = (built(scene, VIEW, SIZE, CUTOFF, wider).tiles for wider in (0.0, 1e-3))
    for place, lamp in enumerate(found.order.tolist()):
        if lamp < len(PLACES):
            where, offset, reach = PLACES[lamp]
            away = float(np.linalg.norm(offset))
            name = f"A lamp {f'{away:.1f} m ' if away else ''}{where} the eye, which reaches {reach:g} m,"
        else:
            name = f"Lamp {lamp}, a {scene.lights[lamp].kind} light,"
        bits = found.tiles[:, :, place] > 0
        lost, more = least[..., lamp] & ~bits, bits & ~most[..., lamp]
        given.need(
            not lost.any(),
            f"{name} reaches {least[..., lamp].sum()} tiles, and has no bit in {lost.sum()} of them.",
        )
        given.need(
            not more.any(), f"{name} has a bit in {bits.sum()} tiles, and cannot reach {more.sum()} of them."
        )
    brute = given.draw(scene, VIEW, size=SIZE, light_lists="brute", graph="deferred")
    other = int((picture != brute).any(axis=-1).sum())
    given.need(other == 0, f"{other} pixels are not what they are with light_lists=brute.")


def _scene() -> Scene:
    lights, poses = [], []
    for number, (_, offset, reach) in enumerate(PLACES):
        pose = np.eye(4)
        pose[:3, 3] = VIEW.world_from_view[:3, 3] + VIEW.world_from_view[:3, :3] @ np.array(offset)
        lights.append(Light("point", node=number, range=reach, intensity=2.0))
        poses.append(pose)
    others, where = lamps(20)
    lights += [Light(**{**vars(light), "node": len(PLACES) + light.node}) for light in others]
    return lit(town(), lights, np.concatenate([np.array(poses), where]))
