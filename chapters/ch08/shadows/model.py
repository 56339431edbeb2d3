"""Which lights cast shadows, and what shaders are built with for them; needs no device."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene

from ..clusters.lights import peaks
from ..scene.packing import LIGHT_KINDS
from .settings import Bias

Defines = tuple[tuple[str, int | float | str], ...]

VIEWS = ("shadow-factor", "cascade")
"""The views that show shadows."""

CUBE_FACES = 6

MOST_SUNS = 4
"""Directional lights that cast shadows: their cascades follow the view in every frame, light by light."""

DIRECTIONAL = LIGHT_KINDS["directional"]


def wanted(settings: Any) -> bool:
    """Whether the settings ask for shadows; a view shows a quantity of a surface, and most of them no light."""
    view = settings.shading.view
    return bool(settings.shadows.shadows == "on" and view in ("picture", "non-finite", *VIEWS))


def needed(scene: Scene, settings: Any) -> bool:
    """Whether a frame has shadows: they are wanted, and there are lights and objects.

    The default light travels with the camera, which hardly sees its shadows (scene/default_light.py).
    """
    lights = [light for light in scene.lights if light.name != "default light"]
    return wanted(settings) and bool(lights) and len(scene.instances) > 0


def records_of(scene: Scene, settings: Any) -> int:
    """Return how many lights have records: those that are kept (clusters/lights.py)."""
    return min(len(scene.lights), int(settings.clusters.most_lights))


def most_faces(scene: Scene, settings: Any) -> int:
    """Return the faces that the lights of a scene may have, whatever kinds edits make of them."""
    return CUBE_FACES * min(records_of(scene, settings), int(settings.shadows.shadow_lights))


def shadow_defines(scene: Scene, settings: Any) -> Defines:
    """Return the defines of all shaders of a scene with shadows: sizes of the buffer, and the filter."""
    if not needed(scene, settings):
        return ()
    knobs = settings.shadows
    return (
        ("SHADOWS", 1),
        ("SHADOW_LIGHTS", padded(records_of(scene, settings))),
        ("SHADOW_FACES", padded(most_faces(scene, settings))),
        ("SHADOW_BIAS", get_args(Bias).index(knobs.shadow_bias)),
        ("SHADOW_CONSTANT", float(knobs.shadow_constant)),
        ("SHADOW_SLOPE", float(knobs.shadow_slope)),
    )


def padded(count: int) -> int:
    """Return `count`, at least 1, as a multiple of 4: vectors of four words follow."""
    return -(-max(1, count) // 4) * 4


def tests_of(settings: Any) -> int:
    """Return the tests of casters against lights, as bits (cull.glsl). Cones need that back faces cast nothing."""
    knobs = settings.shadows
    cones = knobs.shadow_cull_cones and knobs.shadow_sides == "front"
    return (
        knobs.shadow_cull_instances + 2 * knobs.shadow_cull_meshlets + 4 * cones + 8 * knobs.shadow_cull_faces
    )


def guard(settings: Any) -> int:
    """Return the texels at each edge of a face that only its filter reaches, so that no tap needs another face."""
    return int(settings.shadows.shadow_kernel) // 2 + 1


def selected(scene: Scene, numbers: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return places in the records of the lights that cast shadows, the most important first.

    `numbers` (L,) are the lights of the scene that have records. Directional lights come first, by lux, then the others
    by candela; of equal ones the first.
    """
    lights = [scene.lights[number] for number in numbers]
    local = np.array([light.kind != "directional" for light in lights], bool)
    order: NDArray[np.intp] = np.lexsort((-peaks(lights), local))
    suns = order[~local[order]]
    return np.concatenate([suns[:MOST_SUNS], order[len(suns) :]])[:most]
