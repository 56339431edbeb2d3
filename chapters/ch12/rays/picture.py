"""What is traced, by which way, and what the shaders of a ray pass are built with. No device."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, get_args

from backends.contract import Plan
from common.errors import UserError
from common.scene import Scene

from ..scene.packing import ROLES, Variant
from ..shading.sky import Sky
from ..shading.views import PICTURE, background
from ..visibility.model import flag_defines
from .bvh.model import CONSTANTS
from .model import SURFACES, opaque_materials
from .settings import View

Defines = tuple[tuple[str, int | float | str], ...]

PIPELINE, QUERY, BVH = "pipeline", "query", "bvh"
"""The ways that find the hits of rays."""

DEFINES: dict[str, Defines] = {
    PIPELINE: (("RAYS_PIPELINE", 1), ("RAYS_SET", 4), ("RAYS_BINDING", 0)),
    QUERY: (("RAYS_QUERY", 1), ("RAYS_SET", 4), ("RAYS_BINDING", 0)),
    BVH: (
        *CONSTANTS.items(),
        ("RAYS_SET", 3),
        ("RAYS_BINDING", 0),
        ("RAYS_SLOT", 5),
    ),
}
"""The defines of a way: where its structures are bound."""

FEATURES = {PIPELINE: "ray-tracing", QUERY: "ray-query"}
"""The feature of a device that a way needs."""


def in_use(scene: Scene, settings: Any) -> bool:
    """Whether a part of the picture is traced; a view of a quantity is rasterised, and so is a scene of nothing."""
    wanted = settings.rays.rays != "off" or settings.paths.path_tracer
    return bool(wanted and settings.shading.view == PICTURE and len(scene.indices))


def first_column(settings: Any, width: int) -> int:
    """Return the columns of a picture of `width` that are left of the traced part."""
    beside = settings.rays.rays == "beside" and not settings.paths.path_tracer
    return math.ceil(settings.rays.ray_split * width) if beside else 0


def most_rays(scene: Scene, settings: Any, size: tuple[int, int]) -> int:
    """Return how many rays a picture of `size` may have: to each light from each surface that a pixel shows."""
    knobs, paths = settings.rays, settings.paths
    if paths.path_tracer:
        lights = 1 + (len(scene.lights) if paths.path_lights == "all" else 0)
        return (
            size[0] * size[1] * int(paths.path_samples) * (1 + lights) * (1 + min(int(paths.path_bounces), 8))
        )
    lights = len(scene.lights) if knobs.ray_shadows else 0
    return (size[0] - first_column(settings, size[0])) * size[1] * (1 + lights) * (1 + knobs.ray_bounces)


def chosen_way(settings: Any, plan: Plan) -> str:
    """Return the way that finds hits.

    Raises UserError if the settings name a way that the device does not have, or a view that the way does not have.
    """
    wanted = str(settings.rays.ray_way)
    if settings.rays.ray_view == "steps":  # drivers count none of theirs
        if wanted not in ("auto", BVH):
            raise UserError(f"ray_view=steps shows the steps of our own BVH: set ray_way={BVH}, or auto.")
        return BVH
    if wanted == "auto":
        return next((way for way, feature in FEATURES.items() if plan.native(feature)), BVH)
    if wanted != BVH and not plan.native(FEATURES[wanted]):
        raise UserError(
            f"ray_way={wanted} needs {FEATURES[wanted]}, which this device does not have or --without switches off: "
            f"set ray_way={BVH}, or auto."
        )
    return wanted


def variant_of_all(variants: Sequence[Variant]) -> Variant:
    """Return the variant with all that any of `variants` needs."""
    defines = sorted({define for variant in variants for define in variant.defines})
    roles = tuple(role for role in ROLES if any(role in variant.roles for variant in variants))
    kept = tuple(it for it in defines if it[0] not in ("ALPHA_MASK", "ALPHA_BLEND", "DOUBLE_SIDED"))
    return Variant(kept, "opaque", False, roles)


def casting_sides(settings: Any) -> str:
    """Return the sides of single-sided surfaces that rays to a light skip: those that cast none in shadow maps."""
    return "SKIP_FRONTS" if settings.shadows.shadow_sides == "front" else "0u"


def surface_defines(scene: Scene, settings: Any, used: Sequence[int]) -> Defines:
    """Return what a picture by rays is built with, besides the variant of its materials and what is its own."""
    sky: Defines = (
        ()
        if Sky.needed(scene, settings)
        else (("BACKGROUND", background(settings, settings.shading.background)),)
    )
    return (
        *flag_defines(),
        *sky,
        *((("TANGENTS_DERIVED", 1),) if settings.visibility.tangents == "derived" else ()),
        *(() if opaque_materials(scene)[list(used)].all() else (("NON_OPAQUE", 1),)),
        ("TILED", 1),
        ("FORMAT", settings.shading.color_format),
    )


def picture_defines(scene: Scene, settings: Any, used: Sequence[int]) -> Defines:
    """Return what picture.glsl is built with, besides the variant of its materials."""
    knobs = settings.rays
    return (
        *surface_defines(scene, settings, used),
        *((("SHADOW_RAYS", 1), ("CASTERS", f"{SURFACES}u")) if knobs.ray_shadows else ()),
        *((("CASTING_SIDES", casting_sides(settings)),) if knobs.ray_shadows else ()),
        *((("SHADOW_NEAR", f"{settings.shadows.shadow_near:.9e}"),) if knobs.ray_shadows else ()),
        ("BOUNCES", int(knobs.ray_bounces)),
        ("MIRROR", float(knobs.ray_mirror)),
        ("RAY_VIEW", get_args(View).index(knobs.ray_view)),
    )
