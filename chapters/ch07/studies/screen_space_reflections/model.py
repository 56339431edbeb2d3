"""Which surfaces reflect, how wide the box of a roughness is, and what the two shaders are built with."""

from __future__ import annotations

import math

import numpy as np

from common.scene import Material, Scene

from ...graph.plan import graph_name
from . import Settings

Defines = tuple[tuple[str, int | float | str], ...]


def mask(roughness: float, settings: Settings) -> float:
    """Return how much of a reflection a surface shows: all of it up to 3/4 of `roughest`, and none from that on."""
    roughest = settings.reflection.roughest
    fade = (roughest - roughness) / (0.25 * roughest)
    return settings.reflection.strength * min(max(fade, 0.0), 1.0)


def box_size(roughness: float, blur: float) -> int:
    """Return the edge of the box over which a reflection is averaged, in pixels: 1 for a mirror, always odd."""
    return 2 * math.floor(blur * roughness + 0.5) + 1


def reflects(material: Material, settings: Settings) -> bool:
    """Whether a material can reflect anywhere; a texture of roughness may have smooth texels."""
    if material.unlit or material.alpha_mode == "blend":  # blended surfaces are not in the G-buffer
        return False
    return material.roughness < settings.reflection.roughest or (
        material.metallic_roughness_texture is not None
    )


def needed(scene: Scene, settings: Settings) -> bool:
    """Whether any pass of reflections has work: a G-buffer, some strength, and a material that reflects."""
    if settings.reflection.strength == 0.0 or graph_name(settings) == "forward":
        return False
    used = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
    return any(reflects(scene.materials[number], settings) for number in used)


def defines(settings: Settings) -> Defines:
    """Return the knobs as both shaders have them."""
    knobs = settings.reflection
    return (
        ("STRENGTH", knobs.strength),
        ("STEPS", knobs.steps),
        ("REFINEMENTS", knobs.refinements),
        ("THICKNESS", knobs.thickness),
        ("ROUGHEST", knobs.roughest),
        ("BLUR", knobs.blur),
        ("EDGE", knobs.edge),
    )
