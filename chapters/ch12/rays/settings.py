"""The knobs of rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Shown = Literal["off", "beside", "whole"]
"""The part of the picture that is traced."""

Way = Literal["auto", "pipeline", "query", "bvh"]
"""What finds the hits of rays."""

View = Literal["picture", "distance", "instance", "barycentrics", "steps"]
"""What a traced pixel shows."""


@dataclass
class RaySettings:
    """What is traced, and how."""

    rays: str = knob(
        "off",
        "the part of the picture that is traced: none, the part right of ray_split, or all of it",
        choices=get_args(Shown),
    )
    ray_split: float = knob(
        0.5, "share of the picture's width that stays rasterised with rays=beside", minimum=0, maximum=1
    )
    ray_way: str = knob(
        "auto",
        "what finds hits: a ray-tracing pipeline, ray queries in compute, or a BVH that compute shaders traverse; auto "
        "takes the first of these that the device has",
        choices=get_args(Way),
    )
    ray_view: str = knob(
        "picture",
        "what a traced pixel shows: light, distance to the hit, number of the instance, barycentric coordinates, or "
        "the steps of our own traversal",
        choices=get_args(View),
    )
    ray_shadows: bool = knob(True, "whether a ray towards each light finds what stands before it")
    ray_mirror: float = knob(
        0.2,
        "roughness up to which a surface shows what a ray in the mirrored direction hits; rougher ones show the "
        "environment, as in the rasterised picture",
        minimum=0,
        maximum=1,
    )
    ray_bounces: int = knob(2, "mirrored rays that follow one another at most", minimum=0, maximum=8)
    ray_rebuild: float = knob(
        2.0,
        "how many times as much as at its build a refitted structure may cost before the GPU builds it anew: 1 or "
        "more; 0 = it is never built anew",
        minimum=0,
    )
    ray_rebuild_budget: int = knob(
        1 << 17, "triangles and instances that a frame builds anew at most", minimum=0
    )
