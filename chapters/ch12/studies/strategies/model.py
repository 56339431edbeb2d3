"""The scene of the study, and the variance of each plate and lamp. No device."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.scene import Material, Scene
from common.view.camera import View

from ..of_paths import Square, square_at, squares

STRATEGIES = ("lights", "bsdf", "mis")

ROUGHNESS = (0.1, 0.2, 0.4, 0.8)
"""Of the plates, from the upper one to the lower one."""

HALVES = (0.05, 0.15, 0.4, 0.9)
"""Half of the edges of the lamps in metres, from left to right."""

POWER = 12.0
"""Nits times square metres of each lamp."""

PLATES = ((2.2, -3.0), (1.2, -1.6), (0.45, 0.0), (0.0, 1.8))
"""Height and depth of the plates' centres."""

EYE, LAMPS = (0.0, 2.2, 8.0), ((-4.0, 5.4, -4.0), (-2.1, 5.4, -4.0), (-0.1, 5.4, -4.0), (3.0, 5.4, -4.0))


def plates_and_lamps() -> Scene:
    """Return the plates, turned so that each mirrors the row of lamps to the eye, and behind them the lamps."""
    placed: list[Square] = []
    middle = np.mean(LAMPS, axis=0)
    for roughness, (y, z) in zip(ROUGHNESS, PLATES, strict=True):
        center = np.array((0.0, y, z))
        ways = [(np.array((0.0, *to[1:])) - center) for to in (EYE, middle)]
        normal = sum(way / np.linalg.norm(way) for way in ways)
        metal = Material(f"plate {roughness}", (0.9, 0.9, 0.9, 1.0), 1.0, roughness, double_sided=True)
        placed.append((square_at(center, normal, (4.2, 0.62)), metal))
    for half, lamp in zip(HALVES, LAMPS, strict=True):
        nits = POWER / (4.0 * half * half)
        glow = Material(f"lamp {half}", (0.0, 0.0, 0.0, 1.0), 1.0, 1.0, emissive=(nits, nits, nits))
        placed.append((square_at(lamp, (-lamp[0], 1.0 - lamp[1], -lamp[2]), (half, half)), glow))
    return squares("plates and lamps", placed, EYE, (0.0, 2.35, -2.0), math.radians(43.0), 0.0)


def shown_plates(ids: NDArray[Any]) -> NDArray[np.bool_]:
    """Return (plates, H, W) which pixels show a plate alone, from ids (H, W) of instances: 0 where there is none."""
    inside = np.stack([ids == 1 + plate for plate in range(len(ROUGHNESS))])
    for axis in (1, 2):
        inside &= np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    inside[:, [0, -1], :] = inside[:, :, [0, -1]] = False
    return inside


def variances(renderer: Any, view: View, frames: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (strategies, plates, lamps) the variance of one path, and (strategies, plates, lamps) the mean light.

    `renderer` draws the scene of the study, with the output "color_linear" and without an average of frames. The
    variance is that of the luminance of a pixel from frame to frame, in parts of the squared mean light that the lamp
    brings to the plate by the combined strategy. Each lamp is measured alone, the others are hidden.
    """
    plates = np.arange(len(ROUGHNESS))
    visible = renderer.scene.instances.visible.copy()
    spread = np.zeros((len(STRATEGIES), len(ROUGHNESS), len(HALVES)))
    light = np.zeros_like(spread)
    inside = shown_plates(np.asarray(renderer.render(view, 0.0).image("instance_id")))
    for lamp in range(len(HALVES)):
        with renderer.scene.edit() as edit:
            for other in range(len(HALVES)):
                edit.set_visible(len(plates) + other, other == lamp)
        for number, strategy in enumerate(STRATEGIES):
            renderer.settings.paths.path_strategy = strategy
            seen = np.stack([
                np.asarray(renderer.render(view, 0.0).image("color_linear"), np.float64)[..., 1]
                for _ in range(frames)
            ])  # fmt: skip
            own = seen.var(axis=0, ddof=1)
            for plate in plates:
                spread[number, plate, lamp] = own[inside[plate]].mean()
                light[number, plate, lamp] = seen.mean(axis=0)[inside[plate]].mean()
    with renderer.scene.edit() as edit:
        for instance, shown in enumerate(visible.tolist()):
            edit.set_visible(instance, shown)
    return spread / light[STRATEGIES.index("mis")] ** 2, light
