"""The deferred path: which formats the G-buffer has, and how a material's shader is cut in two, surface and light."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from backends.contract import Access
from common.scene import Scene

from ..post.settings import PostSettings
from ..scene.packing import Variant
from ..visibility.model import in_use
from ..visibility.settings import VisibilitySettings
from .settings import ShadingSettings
from .views import PICTURE, background

Defines = tuple[tuple[str, int | float | str], ...]

TARGETS = ("gbuffer_base_color", "gbuffer_normal", "gbuffer_material")
"""The G-buffer, in the order of its locations in shading/gbuffer.glsl, which says what is in which channel."""

EMISSION = "gbuffer_emissive"
"""The last target, which only a scene with emission has."""

FORMATS: dict[str, tuple[str, ...]] = {
    "octahedral": ("rgba8_srgb", "r32ui", "rgba8", "rgba16f"),
    "compact": ("rgba8_srgb", "rgb10a2", "rgba8", "rgba16f"),
    "half": ("rgba8_srgb", "rgba16f", "rgba8", "rgba16f"),
    "full": ("rgba32f",) * 4,
}
"""Formats of the targets by the setting `gbuffer_format`.

Base colour: 8 bits in the code of sRGB, as its textures have them. Eight bits of linear light have steps of 1/255,
which is a fifth of a dark wood's 0.02; those of the code are 1 to 2 % of a colour anywhere above 0.02.
Normal: a mirror shows a turn of its normal doubled. Ten bits keep a component within 1/1022, at most 0.1 degrees of
turn, and an upright normal exactly; halves within 2^-12 of its value, 0.03 degrees, in twice the memory. 8 bits would
be off by 0.4 degrees, and a highlight's edge would show the steps. An octahedral code of twice 16 bits takes the
memory of the ten bits and is off by 0.004 degrees. It is packed into a whole number: all devices draw to such a target.
Material: occlusion, roughness and metalness come from textures of 8 bits, which stay exact.
Emission: has no upper end, and arrives exposed: halves, as in the picture itself.
"""

STORED = {"rgba8_srgb": "rgba8", "rgb10a2": "r32ui"}
"""Formats in place of those that no device, or not every one, stores from a compute shader (visibility/resolve.py).

Base colour keeps the code of sRGB, which shaders compute. A normal of ten bits becomes an octahedral code, of as many
bytes and a smaller error.
"""

_LIGHT = ("LIT", "ENVIRONMENT", "ENERGY")
"""The parts of a variant that only light needs."""


class Settings(Protocol):
    """The settings of the deferred path."""

    shading: ShadingSettings
    post: PostSettings
    visibility: VisibilitySettings


def possible(settings: Settings) -> bool:
    """Whether a G-buffer can hold what is asked for: light, and one surface at each pixel.

    A view shows what a surface has, which the forward pass knows in full; several samples a pixel would need as many
    surfaces, all of them lit.
    """
    return settings.shading.view == PICTURE and settings.shading.msaa == 1


def emits(scene: Scene, settings: Settings) -> bool:
    """Whether any solid material sends out light of its own; what is unlit shows its colour as if it did."""
    used = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
    solid = [scene.materials[number] for number in used if scene.materials[number].alpha_mode != "blend"]
    sources = any(material.unlit or max(material.emissive) > 0.0 for material in solid)
    return sources or not settings.shading.skip_unused


def layout(settings: Settings) -> tuple[str, ...]:
    """Return the formats of TARGETS and EMISSION."""
    formats = FORMATS[settings.shading.gbuffer_format]
    return tuple(STORED.get(format, format) for format in formats) if in_use(settings) else formats


def written(settings: Settings) -> tuple[Access, ...]:
    """Return the G-buffer as the pass declares it that writes it; the last one is EMISSION.

    They are cleared, so the driver loads no old contents; pixels of depth 0 are not read.
    """
    formats = layout(settings)
    return tuple(
        Access(
            name,
            "color",
            format=format,
            clear=(0, 0, 0, 0) if format.endswith("ui") else (0.0, 0.0, 0.0, 0.0),
        )
        for name, format in zip((*TARGETS, EMISSION), formats, strict=True)
    )


def sampled(settings: Settings) -> tuple[Access, ...]:
    """Return the reads of a pass that samples TARGETS; those that hold whole numbers say so."""
    formats = layout(settings)
    return tuple(
        Access(name, "sampled", format=format if format.endswith("ui") else None)
        for name, format in zip(TARGETS, formats, strict=False)
    )


def formats(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """Return the formats of the targets that the scene has."""
    return layout(settings)[: len(TARGETS) + emits(scene, settings)]


def emission_defines(scene: Scene, settings: Settings) -> Defines:
    """Return the define of shaders that write or read the emission."""
    return (("EMISSION", 1),) if emits(scene, settings) else ()


def code_defines(settings: Settings) -> Defines:
    """Return the defines that tell shaders how base colour and normals are stored."""
    stored = {"rgba8": "BASE_COLOR_CODED", "rgb10a2": "NORMAL_CODED", "r32ui": "NORMAL_OCTAHEDRAL"}
    return tuple((stored[format], 1) for format in layout(settings)[:2] if format in stored)


def surface_alone(variant: Variant) -> Variant:
    """Return the variant that finds out what a surface is, and lights nothing."""
    return replace(variant, defines=tuple(define for define in variant.defines if define[0] not in _LIGHT))


def light_defines(variants: Iterable[Variant], sky: bool, settings: Settings) -> Defines:
    """Return what lighting.frag is built with for surfaces of these variants, with or without a `sky` behind them."""
    lighting = {name: value for variant in variants for name, value in variant.defines if name in _LIGHT}
    behind: tuple[str, int | float | str] = ("BACKGROUND", background(settings, settings.shading.background))
    return (*sorted(lighting.items()), *code_defines(settings), ("SKY", 1) if sky else behind)


def has_transparent(scene: Scene) -> bool:
    """Whether any object has a material that lets light through."""
    used = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
    return any(scene.materials[material].alpha_mode == "blend" for material in used)
