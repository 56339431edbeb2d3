"""Which lights cast shadows, and what shaders are built with for them; needs no device."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from common.scene import Scene

from ..scene.packing import LIGHT_KINDS
from .settings import Bias
from .views import SHADOWS

Defines = tuple[tuple[str, int | float | str], ...]

TILE = 128
TILE_BYTES = TILE * TILE * 4
"""A tile is a page of sparse memory: 64 KiB of R32F."""

CUBE_FACES = 6

WIDEST_RADIUS = 16
"""Texels of the widest filter of soft shadows; an eighth of a face if that is less."""

MOST_SUNS = 4
"""Directional lights that cast shadows: their cascades follow the view in every frame, light by light."""

DIRECTIONAL = LIGHT_KINDS["directional"]


def wanted(settings: Any) -> bool:
    """Whether the settings ask for shadows; a view shows a quantity of a surface, and most of them no light."""
    view = settings.shading.view
    return bool(settings.shadows.shadows == "on" and view in ("picture", "non-finite", *SHADOWS))


def possible(scene: Scene, settings: Any) -> bool:
    """Whether a renderer of the scene has shadows: they are wanted, and there are lights and objects.

    The default light travels with the camera, which hardly sees its shadows (scene/default_light.py).
    """
    lights = [light for light in scene.lights if light.name != "default light"]
    return wanted(settings) and bool(lights) and len(scene.instances) > 0


def needed(scene: Scene, settings: Any) -> bool:
    """Whether a frame has shadows: they are possible, and light falls on any object."""
    used = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
    return possible(scene, settings) and any(not scene.materials[material].unlit for material in used)


def records_of(scene: Scene, settings: Any) -> int:
    """Return how many lights have records: those that are kept (clusters/lights.py)."""
    return min(len(scene.lights), int(settings.clusters.most_lights))


def most_suns(scene: Scene, settings: Any) -> int:
    """Return how many directional lights cast shadows."""
    suns = sum(light.kind == "directional" for light in scene.lights)
    return min(suns, MOST_SUNS, int(settings.shadows.shadow_lights))


def most_lamps(scene: Scene, settings: Any) -> int:
    """Return how many other lights may cast shadows at a time."""
    lamps = sum(light.kind != "directional" for light in scene.lights)
    left = int(settings.shadows.shadow_lights) - most_suns(scene, settings)
    return min(lamps, records_of(scene, settings), left)


def most_faces(scene: Scene, settings: Any) -> int:
    """Return the faces of all of them, at least 1."""
    suns = most_suns(scene, settings) * int(settings.shadows.shadow_cascades)
    return max(1, suns + CUBE_FACES * most_lamps(scene, settings))


def _tiles(size: int) -> int:
    return (-(-size // TILE)) ** 2


def table_words(scene: Scene, settings: Any) -> int:
    """Return the words of the table: one for each tile that any face may have."""
    knobs = settings.shadows
    suns = most_suns(scene, settings) * knobs.shadow_cascades * _tiles(knobs.shadow_sun_size)
    return int(suns + most_lamps(scene, settings) * CUBE_FACES * _tiles(knobs.shadow_size))


def pool_tiles(scene: Scene, settings: Any) -> int:
    """Return the tiles of the pages: as many as the table has words, or as the pool holds."""
    most = int(settings.shadows.shadow_pool * 2**20) // TILE_BYTES
    return max(1, min(table_words(scene, settings), most))


def sun_size(scene: Scene, settings: Any, tiles: int) -> int:
    """Return the texels along a cascade: what is asked for, or half of it and so on until `tiles` hold all of them.

    Lamps keep a tile each. 0 if not even one tile a cascade is there.
    """
    size, cascades = int(settings.shadows.shadow_sun_size), most_suns(scene, settings)
    cascades *= int(settings.shadows.shadow_cascades)
    room = max(tiles - most_lamps(scene, settings), min(tiles, cascades))
    while size > TILE and cascades * _tiles(size) > room:
        size //= 2
    return size if cascades * _tiles(size) <= room else 0


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
        *(_soft(knobs) if knobs.shadow_filter == "pcss" else ()),
    )


def _soft(knobs: Any) -> Defines:
    """Return the sizes of lights: length scales of the scene, and the tangent of an angle."""
    return (
        ("SHADOW_LAMP", float(knobs.shadow_lamp)),
        ("SHADOW_SUN", float(np.tan(np.radians(knobs.shadow_sun_angle)))),
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


def guard(settings: Any, size: Any) -> Any:
    """Return the texels at each edge of faces of a size that only filters reach, so that no tap needs another face.

    It is 1 more than the radius of the kernel, or of the widest one of soft shadows.
    """
    if settings.shadows.shadow_filter == "pcss":
        return np.minimum(WIDEST_RADIUS, size // 8) + 1
    return size * 0 + settings.shadows.shadow_kernel // 2 + 1
