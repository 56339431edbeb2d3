"""The knobs of shadows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Bias = Literal["plane", "slope", "none"]
"""What keeps a surface from shading itself: its plane at each tap, an offset by its slope, or nothing."""

MOST_LIGHTS = 256
"""Lights that may cast shadows."""


@dataclass
class ShadowSettings:
    """Which lights cast shadows, how finely, and how edges are filtered."""

    shadows: str = knob("on", "whether lights cast shadows", choices=("on", "off"))
    shadow_lights: int = knob(
        MOST_LIGHTS,
        "lights that cast shadows, the brightest of the scene; the others are counted",
        minimum=1,
        maximum=MOST_LIGHTS,
    )
    shadow_memory: str = knob(
        "pages",
        "texels of spot and point lights: as many as the picture asks for, or shadow_size for all of them",
        choices=("pages", "full"),
    )
    shadow_size: int = knob(
        512,
        "texels along a face of a spot or point light, at most",
        choices=(128, 256, 512, 1024, 2048),
    )
    shadow_detail: float = knob(
        0.7,
        "texels along a face of a spot or point light for each pixel that it shades, with shadow_memory=pages",
        unit="texels",
        minimum=0.01,
        maximum=16,
    )
    shadow_sun_size: int = knob(
        1024,
        "texels along a cascade of a directional light",
        choices=(256, 512, 1024, 2048, 4096),
    )
    shadow_cascades: int = knob(
        3,
        "maps of a directional light: the last one covers the scene, those before it the view, near parts finer",
        minimum=1,
        maximum=4,
    )
    shadow_kernel: int = knob(
        3,
        "texels along the box over which comparisons are averaged; 1: a hard edge",
        choices=(1, 3, 5, 7, 9, 11, 13),
    )
    shadow_loop: str = knob(
        "auto",
        "what the loop over the kernel takes its length from: a constant of the pipeline, by which the driver unrolls "
        "it, or the record of a face; auto: the constant where this gains",
        choices=("auto", "constant", "record"),
    )
    shadow_filter: str = knob(
        "pcf",
        "edges of one width, the kernel's, or as wide as the light and the way from the caster make them",
        choices=("pcf", "pcss"),
    )
    shadow_lamp: float = knob(
        0.003,
        "radius of spot and point lights, with shadow_filter=pcss",
        unit="length scales",
        minimum=0,
        maximum=1,
    )
    shadow_sun_angle: float = knob(
        0.27,
        "half the angle that directional lights cover in the sky, with shadow_filter=pcss",
        unit="degrees",
        minimum=0,
        maximum=20,
    )
    shadow_bias: str = knob(
        "plane",
        "what keeps a surface from shading itself: its plane at each texel, an offset by its slope, or nothing",
        choices=get_args(Bias),
    )
    shadow_constant: float = knob(
        1.0,
        "bias that every surface gets, in texels at its place",
        unit="texels",
        minimum=0,
        maximum=100,
    )
    shadow_slope: float = knob(
        1.0,
        "bias for each unit of the tangent of the angle between normal and light, in texels at its place",
        unit="texels",
        minimum=0,
        maximum=100,
    )
    shadow_near: float = knob(
        1e-3,
        "distance from a light within which nothing casts its shadow, in the scene's length scales",
        unit="length scales",
        minimum=1e-9,
        maximum=1,
    )
    shadow_sides: str = knob(
        "both",
        "which sides of a surface that has one cast shadows: both, or the front alone",
        choices=("both", "front"),
    )
    shadow_cull_instances: bool = knob(True, "whether objects beyond the reach of a light are left out")
    shadow_cull_meshlets: bool = knob(True, "whether meshlets beyond the reach of a light are left out")
    shadow_cull_cones: bool = knob(
        True,
        "whether meshlets that face away from a light are left out, with shadow_sides=front",
    )
    shadow_cull_faces: bool = knob(True, "whether a face leaves out what is outside of it")
    page_budget: int = knob(
        256,
        "tiles of shadow maps that get memory in a frame, at most; the first frame and cuts have no limit",
        unit="tiles of 64 KiB",
        minimum=1,
        maximum=16384,
    )
    shadow_pool: float = knob(
        128.0,
        "memory of all shadow maps together; a page has 1/16 MiB",
        unit="MiB",
        minimum=1 / 16,
        maximum=1024,
    )
