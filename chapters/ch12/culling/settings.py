"""The knobs of culling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Mode = Literal["off", "frustum", "cone", "occlusion"]
"""The tests of a frame. Each word includes the tests of the words before it."""

Geometry = Literal["mesh", "compute", "classic"]
"""What draws solid objects: mesh shaders, the meshlets that compute shaders select, or whole meshes."""


Shown = Literal["boxes", "spheres", "pyramid"]
"""What the overlay shows."""


@dataclass
class CullingSettings:
    """Which objects and meshlets a frame leaves out, and what draws the others."""

    mode: str = knob(
        "auto",
        "tests of objects and meshlets, each word with those before it; auto: none in a small scene",
        choices=("auto", *get_args(Mode)),
        flat="culling",
    )
    geometry: str = knob(
        "auto",
        "mesh shaders, meshlets selected by compute, or whole meshes; auto: what the device draws fastest",
        choices=("auto", *get_args(Geometry)),
        flat="geometry",
    )
    lod_pixels: float = knob(
        0.0,
        "how far a coarser level of a mesh may be off in the picture, at most; 0: every mesh is drawn in full",
        unit="pixels",
        minimum=0,
        maximum=100,
        flat="lod_pixels",
    )
    frozen: bool = knob(
        False, "whether culling keeps the view that it has now", live=True, flat="culling_frozen"
    )
    overlay: str = knob(
        "off",
        "what is drawn over the picture: boxes of objects (green: seen, red: left out), spheres of seen objects' "
        "meshlets (green: drawn, red: outside, violet: facing away, orange: hidden), or a level of the depth pyramid",
        choices=("off", *get_args(Shown)),
        flat="culling_overlay",
    )
    level: int = knob(
        4,
        "level of the depth pyramid that the overlay shows, each half the size of the one before; at most the last",
        minimum=1,
        maximum=14,
        live=True,
        flat="culling_level",
    )
