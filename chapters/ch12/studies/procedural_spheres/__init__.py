"""Study: spheres without triangles. Structures hold boxes, and an intersection shader finds the sphere in a box.

A structure knows triangles and boxes. Where a ray meets a box, the driver runs the intersection shader of the hit
group; it finds the sphere in the box and reports the parameter t and a number, the *kind* of the hit (here: from
outside, or from inside). The driver keeps the nearest reported hit, as with triangles, and runs the closest-hit
shader in the end. Boxes may overlap, and a ray meets many whose spheres it misses: a box has 6/pi times the volume of
its sphere.

Without ray pipelines, and in OpenGL, a kernel asks every sphere for every ray. The function of one sphere is the
same, so pixels are, too; the counter `tests` says how often it ran.

The ray meets the sphere where t^2 - 2 b t + c = 0, with b = -f d, c = f f - r^2 and f from the centre to the ray's
origin. The usual discriminant b^2 - c is a difference of large numbers if the sphere is small or far away. r^2 - |f +
b d|^2 is the same on paper, of lengths across the ray; and with q = b + sign(b) sqrt(...) the solutions are c / q and
q, without a difference (Haines, Günther and Akenine-Möller 2019, "Precision Improvements for Ray/Sphere
Intersection"). --set discriminant=usual shows what is lost: move away from small spheres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.lessons import OWN, Study
from common.scene import Scene
from common.settings import knob

from ..seen import camera_scene

STUDY = Study(
    title="procedural spheres",
    idea="A structure needs boxes; what is in them is the intersection shader's matter.",
    order=2,
    features=("ray-tracing/any-hit-and-intersection",),
    scene=OWN,
)

FOLDER = "studies/procedural_spheres"
RAYGEN, KERNEL = f"{FOLDER}/spheres.rgen", f"{FOLDER}/spheres.comp"
MISS, CLOSEST, INTERSECTION = (f"{FOLDER}/sphere.{stage}" for stage in ("rmiss", "rchit", "rint"))

GROUND = 50.0
"""Metres of the radius of the sphere on which the others lie."""

FIELD = 3.2
"""Metres from the middle to the farthest sphere."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    spheres: int = knob(120, "spheres on the ground", minimum=1, maximum=4096)
    discriminant: str = knob(
        "stable",
        "how a sphere is met: by lengths across the ray, or as books have it",
        choices=("stable", "usual"),
    )


def own_scene() -> Scene:
    """Return a camera before the field; shaders know the spheres."""
    return camera_scene("spheres", (0.0, 2.4, 6.0), (0.0, 0.2, 0.0), math.radians(40.0))


def spheres(settings: Settings) -> NDArray[np.float32]:
    """Return (N + 1, 4) centres and radii, the ground first, the others by lot on it, smaller where there are more."""
    random = np.random.default_rng(12)
    count = settings.spheres
    radii = random.uniform(0.5, 1.0, count) * min(0.45, 2.2 / math.sqrt(count))
    angle, far = random.uniform(0, 2 * np.pi, count), FIELD * np.sqrt(random.random(count))
    x, z = far * np.cos(angle), far * np.sin(angle)
    y = np.sqrt((GROUND + radii) ** 2 - x**2 - z**2) - GROUND
    others = np.stack([x, y, z, radii], axis=1)
    return np.concatenate([[(0.0, -GROUND, 0.0, GROUND)], others]).astype(np.float32)


def boxes(places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 6) the boxes of spheres (N, 4), rounded outwards."""
    centres, radii = places[:, :3].astype(np.float64), places[:, 3:].astype(np.float64)
    low, high = (centres - radii).astype(np.float32), (centres + radii).astype(np.float32)
    return np.concatenate(
        [np.nextafter(low, np.float32(-np.inf)), np.nextafter(high, np.float32(np.inf))], axis=1
    )


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders."""
    return (("USUAL", 1),) if settings.discriminant == "usual" else ()


def told(counts: NDArray[np.uint32]) -> dict[str, int]:
    """Return the counters of a frame that the GPU counted."""
    return {"tests": int(counts[0])}
