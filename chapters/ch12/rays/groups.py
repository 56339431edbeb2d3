"""The groups of the ray pipeline: what runs where a ray hits and misses, for every pass that traces."""

from __future__ import annotations

from ..pipelines.ray_description import HitGroup, RayDescription

MISSES = ("rays/miss.rmiss", "rays/open.rmiss")
"""The miss shaders of `trace` and of `occluded` (rays/pipeline.glsl)."""

CLOSEST, ANY = "rays/hit.rchit", "rays/hit.rahit"


def ray_description(
    raygen: str,
    defines: tuple[tuple[str, int | float | str], ...] = (),
    name: str = "",
    linked: bool = False,
) -> RayDescription:
    """Return the description of a pass that traces by the functions of rays/pipeline.glsl.

    `defines` place the set (RAYS_SET, RAYS_BINDING); with NON_OPAQUE surfaces are asked by `accept` (rays/accept.glsl).
    """
    asked = any(define == "NON_OPAQUE" for define, _ in defines)
    hits = (HitGroup(CLOSEST, ANY if asked else ""),)
    return RayDescription(
        raygen, MISSES, hits, defines=(("RAYS_PIPELINE", 1), *defines), name=name, linked=linked
    )
