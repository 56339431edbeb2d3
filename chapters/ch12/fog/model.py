"""Fog without a device: the medium of a scene and its settings, the grid, what is refused, and the layout of the store.

Lengths are in metres. Near and far of the grid are multiples of the scene's length scale, and need not be those of the
camera. Slice s of N ends at the depth near * (far / near)^((s + 1) / N), the first begins at the eye
(shaders/slices.glsl).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import UnsupportedError, UserError
from common.numerics import blue_noise
from common.scene import Medium, Scene
from common.view.camera import View

from .settings import OF_SCENE, FogSettings

Defines = tuple[tuple[str, int | float | str], ...]

MOST_BOXES = 8
"""Boxes of a medium, at most: each froxel and each way of light tests all."""

MOST_ANISOTROPY = 0.99
"""Beyond it the peak of the phase function is more than a half holds, for lights of some thousand candela."""

REST_FRAMES = 64
"""Frames of a view without changes that are averaged; after them the history stays as it is."""

WIND = (1.0, 0.1, 2.0)
"""The direction of the wind."""

WORD_BYTES = 16
"""A word of the store is a uvec4."""

VIEWS = ("fog-slices", "fog-transmittance")
"""The views of fog, which need a grid; the second one needs what is in it, too."""


def wanted(settings: Any) -> bool:
    """Whether the settings allow fog: in the picture and in its views; other views show surfaces alone."""
    return bool(settings.fog.fog and settings.shading.view in ("picture", *VIEWS))


def medium_of(scene: Scene, knobs: FogSettings) -> Medium:
    """Return the medium of a scene, with what the knobs say in place of what the scene says."""
    medium = scene.medium or Medium()
    chosen: dict[str, Any] = {
        "extinction": knobs.fog_density,
        "height_extinction": knobs.fog_height,
        "height_falloff": knobs.fog_falloff,
    }
    chosen = {name: value for name, value in chosen.items() if value != OF_SCENE}
    if knobs.fog_albedo != OF_SCENE:
        grey = (knobs.fog_albedo,) * 3
        boxes = tuple(replace(box, albedo=grey) for box in medium.boxes)
        chosen |= {"albedo": grey, "boxes": boxes}
    return replace(medium, **chosen)


def needed(scene: Scene, settings: Any) -> bool:
    """Whether a renderer of the scene has fog: the medium takes light anywhere."""
    if not wanted(settings):
        return False
    medium = medium_of(scene, settings.fog)
    extinctions = (medium.extinction, medium.height_extinction, *(box.extinction for box in medium.boxes))
    return any(value > 0.0 for value in extinctions)


def in_use(scene: Scene, settings: Any) -> bool:
    """Whether frames have froxels: a view of slices shows their places alone, and paths meet the medium itself."""
    return needed(scene, settings) and settings.shading.view != VIEWS[0] and not settings.paths.path_tracer


def check(scene: Scene, settings: Any) -> None:
    """Raise UserError for a medium or a grid that there cannot be."""
    knobs = settings.fog
    medium = medium_of(scene, knobs)
    quantities = {
        "fog_density": medium.extinction,
        "fog_height": medium.height_extinction,
        "fog_falloff": medium.height_falloff,
    }
    quantities |= {f"the density of fog box {i}": box.extinction for i, box in enumerate(medium.boxes)}
    for name, value in quantities.items():
        if not 0.0 <= value < math.inf:
            raise UserError(f"{name} is {value:g}: it is a number per metre, 0 or more.")
    for i, box in enumerate(medium.boxes):
        if not all(0.0 <= half < math.inf for half in box.half_size):
            raise UserError(f"Half the size of fog box {i} is {box.half_size}: it is metres, 0 or more.")
    for albedo in (medium.albedo, *(box.albedo for box in medium.boxes)):
        if not all(0.0 <= value <= 1.0 for value in albedo):
            raise UserError(f"The albedo of fog is {albedo}: it is a share from 0 to 1 in each channel.")
    if not abs(knobs.fog_anisotropy) <= MOST_ANISOTROPY:
        raise UserError(
            f"fog_anisotropy={knobs.fog_anisotropy:g} is no mean cosine that can be drawn: set one from "
            f"-{MOST_ANISOTROPY:g} to {MOST_ANISOTROPY:g}."
        )
    if not knobs.fog_near < knobs.fog_far:
        raise UserError(
            f"fog_near={knobs.fog_near:g} is not in front of fog_far={knobs.fog_far:g}: set a lower one."
        )
    if len(medium.boxes) > MOST_BOXES:
        raise UserError(
            f"The scene has {len(medium.boxes)} boxes of fog, and at most {MOST_BOXES} are drawn."
        )


def check_device(settings: Any, limits: Mapping[str, int], size: tuple[int, int]) -> None:
    """Raise UnsupportedError for a grid that a device cannot hold."""
    knobs, most = settings.fog, limits.get("maxImageDimension3D", 256)
    grid = grid_of(knobs)
    if max(grid) > most:
        shown = "x".join(map(str, grid))
        raise UnsupportedError(
            f"A grid of {shown} froxels is more than this device holds, whose 3D images have {most} texels along an "
            "edge: set fog_columns, fog_rows and fog_slices lower."
        )
    needed_bytes, seen = (
        places_of(settings, size).words * WORD_BYTES,
        limits.get("maxStorageBufferRange", 1 << 27),
    )
    if needed_bytes > seen:
        raise UnsupportedError(
            f"The records of {math.prod(grid)} froxels take {needed_bytes} bytes, and shaders of this device see "
            f"{seen}: set fog_columns, fog_rows or fog_slices lower."
        )


def grid_of(knobs: FogSettings) -> tuple[int, int, int]:
    """Return the froxels across, down and in depth."""
    return knobs.fog_columns, knobs.fog_rows, knobs.fog_slices


def range_of(scene: Scene, knobs: FogSettings) -> tuple[float, float]:
    """Return near and far of the grid in metres."""
    return knobs.fog_near * scene.length_scale, knobs.fog_far * scene.length_scale


def noise_in_use(settings: Any) -> bool:
    """Whether the medium has noise."""
    return bool(settings.fog.fog_noise > 0.0)


def half_in_use(settings: Any) -> bool:
    """Whether fog is looked up at half resolution: a view shows it in full."""
    return bool(settings.fog.fog_half and settings.shading.view == "picture")


@dataclass(frozen=True)
class Places:
    """The places of parts of the store, in words, behind ranks of blue noise: records of froxels, pixels of fog."""

    froxels: int
    pixels: int
    columns: int
    words: int


def places_of(settings: Any, size: tuple[int, int]) -> Places:
    """Return the layout of the store, for a picture of (width, height)."""
    knobs = settings.fog
    froxels = blue_noise.SIZE**2 // 4
    pixels = froxels + math.prod(grid_of(knobs)) * (2 if knobs.fog_format == "rgba32f" else 1)
    columns, rows = (-(-side // 2) for side in size) if half_in_use(settings) else (0, 0)
    return Places(froxels, pixels, columns, pixels + columns * rows)


def tables_in_use(settings: Any) -> bool:
    """Whether froxels read blue noise, or noise."""
    return bool(settings.fog.fog_temporal) or noise_in_use(settings)


def table_bytes(settings: Any) -> int:
    """Return the bytes of the tables: ranks of blue noise, then a volume of halves."""
    noise = 2 * settings.fog.fog_noise_size**3 if noise_in_use(settings) else 0
    return int(4 * blue_noise.SIZE**2 + noise)


def ranks() -> NDArray[np.uint32]:
    """Return the beginning of the store and of the tables: for each texel of blue noise two ranks of 16 bits."""
    table = blue_noise.ranks().astype(np.uint32)
    words: NDArray[np.uint32] = (table[..., 0] | table[..., 1] << np.uint32(16)).reshape(-1)
    return words


def fog_defines(scene: Scene, settings: Any) -> Defines:
    """Return the defines of all shaders of a scene with fog. What a slider changes is data, and no define."""
    if not needed(scene, settings):
        return ()
    knobs = settings.fog
    return (
        ("FOG", 1),
        ("FOG_BOXES", MOST_BOXES),
        *((("FOG_FULL", 1),) if knobs.fog_format == "rgba32f" else ()),
    )


class Extent:
    """Where a medium is: anywhere, or in boxes alone, which can be out of view. The grid ends at `far` metres.

    A frame computes with plain numbers: for so few of them, calls of numpy would cost more.
    """

    def __init__(self, medium: Medium, far: float) -> None:
        self._anywhere, self._far = medium.extinction > 0.0 or medium.height_extinction > 0.0, far
        self._boxes = [(box.center, box.half_size) for box in medium.boxes if box.extinction > 0.0]
        self._lens: Any = None

    def in_view(self, view: View, aspect: float) -> bool:
        """Whether any of the medium may be in the grid.

        A box is out of view if it is outside of a plane of the frustum, with the corner that is farthest along the
        plane's normal.
        """
        if self._anywhere:
            return True
        if self._lens != (view.projection, aspect):
            self._lens, self._planes = (view.projection, aspect), self._planes_of(view.clip_from_view(aspect))
        (xx, xy, xz, eye_x), (yx, yy, yz, eye_y), (zx, zy, zz, eye_z), _ = view.world_from_view.tolist()
        for (x, y, z), (width, height, length) in self._boxes:
            x, y, z = x - eye_x, y - eye_y, z - eye_z
            for a, b, c, d in self._planes:
                nx, ny, nz = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
                if nx * x + abs(nx) * width + ny * y + abs(ny) * height + nz * z + abs(nz) * length + d < 0.0:
                    break
            else:
                return True
        return False

    def _planes_of(self, clip_from_view: NDArray[np.float64]) -> list[list[float]]:
        """Return the planes of the grid in view space: a point p is inside of (n, d) where dot(n, p) + d >= 0."""
        x, y, _, w = clip_from_view
        planes = np.stack([w + x, w - x, w + y, w - y, (0.0, 0.0, -1.0, 0.0), (0.0, 0.0, 1.0, self._far)])
        return planes.tolist()
