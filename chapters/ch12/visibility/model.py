"""What the visibility buffer stores, and what shaders know of materials and draw commands for it. No device.

A pixel holds two words: the number of its instance plus 1, so that 0 is the background, and the place of the first
index of its triangle among the indices of its mesh. Three times `gl_PrimitiveID` alone would be that place only in a
draw of the whole mesh. The commands that culling writes draw ranges of it, so their vertex offset is the place of the
first index of the range. Vertex shaders subtract the offset again, and every pass that reads such commands has the
define INDEX_CODE. Both numbers stay below 2^26: a page of 128 MiB has 2^25 words.

Coarser levels of detail lie behind the indices of their mesh, so the place says which level was drawn, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from common.scene import Material

from .settings import Surfaces

VISIBILITY: Surfaces = "visibility"

RESOLVE = "visibility_resolve"
"""The name of the pass that fills the G-buffer from the visibility buffer."""

FORMAT = "rg32ui"
"""The format of the two words."""

INDEX_CODE = "INDEX_CODE"

UNLIT, DOUBLE_SIDED, MASKED, BLENDED = 32, 64, 128, 256
"""Bits of a material's flags; the lower five are the roles that have a texture."""

BACK = 1 << 31
"""The bit of the second word of a triangle that is seen from behind."""

SET = 5
"""The place of the set of textures in a material's numbers of textures, behind those of the five roles."""

NO_TRIANGLES = "{} gives fragments no number of their triangle: set surfaces=gbuffer."


def in_use(settings: Any) -> bool:
    """Whether frames have a visibility buffer: a view and several samples a pixel take the forward pass instead."""
    shading = settings.shading
    return bool(
        settings.visibility.surfaces == VISIBILITY and shading.view == "picture" and shading.msaa == 1
    )


def without_effect(settings: Any) -> str:
    """Return the sentence about `surfaces=visibility` in frames that take the forward pass instead; "" for others."""
    shading, overlay = settings.shading, settings.culling.overlay
    if settings.visibility.surfaces != VISIBILITY:
        return ""
    if shading.msaa > 1:
        why = f"msaa={shading.msaa}, since a G-buffer holds one sample a pixel"
    elif shading.view != "picture":
        why = f"view={shading.view}, which shows a quantity of surfaces while they are drawn"
    elif overlay != "off":
        why = f"culling_overlay={overlay}, which is drawn over the forward pass"
    else:
        return ""
    return f"surfaces={VISIBILITY} has no effect with {why}."


def index_defines(settings: Any) -> tuple[tuple[str, int], ...]:
    """Return the define of all shaders that write or read draw commands with the place of their first index."""
    return ((INDEX_CODE, 1),) if in_use(settings) else ()


def flag_defines() -> tuple[tuple[str, int | str], ...]:
    """Return the bits that shaders read and write."""
    bits = ("UNLIT_FLAG", UNLIT), ("DOUBLE_SIDED_FLAG", DOUBLE_SIDED), ("BACK", f"{BACK}u")
    return (*bits, ("MASKED_FLAG", MASKED), ("BLENDED_FLAG", BLENDED))


def material_flags(material: Material, roles: Sequence[str]) -> int:
    """Return what the shader that resolves all materials asks of one: a bit for each of `roles` with a texture, UNLIT,
    DOUBLE_SIDED, and MASKED or BLENDED.

    The forward shader is built for one kind of material, and knows these from its defines.
    """
    sampled = sum(1 << roles.index(role) for role in material.textures())
    flags = sampled | UNLIT * material.unlit | DOUBLE_SIDED * material.double_sided
    return flags | {"mask": MASKED, "blend": BLENDED}.get(material.alpha_mode, 0)
