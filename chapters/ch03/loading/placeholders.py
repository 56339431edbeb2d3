"""What materials sample until their textures have arrived: one texel that leaves the picture as it is.

That is white, for nothing that is sampled but a normal has another neutral value: every other texture is multiplied
with a factor. A white normal would be none of length 1; there it is the one that points straight up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.scene import Sampler

from ..scene.packing import ROLES
from ..scene.textures.arrays import LAYER_SHIFT, ArrayPlan, ArrayTexture
from ..scene.textures.reads import Read, Use
from ..scene.textures.texels import NEUTRAL, Key, Shape

_VALUES = tuple(dict.fromkeys(NEUTRAL.values()))

READS = {role: Read(("neutral", value), Sampler()) for role, value in NEUTRAL.items()}
"""What stands for a texture in a role; the number of a role's placeholder is all that its material needs."""

ARRAY = ArrayTexture(
    Shape(1, 1, "rgba16f", None, 1), Sampler(), tuple(("neutral", value) for value in _VALUES)
)
"""All placeholders as the layers of one array texture."""

UNITS = 1
"""Arrays of a set that placeholders take: the first one."""


def of_role(role: int) -> int:
    """Return how a material's record names the placeholder of a role in a plan of `with_placeholders`."""
    return _VALUES.index(NEUTRAL[ROLES[role]]) << LAYER_SHIFT


def with_placeholders(plan: ArrayPlan) -> ArrayPlan:
    """Return a plan whose sets hold `ARRAY` before all others, so that every role can sample it."""
    if not plan.arrays:
        return plan
    number = len(plan.arrays)
    return replace(
        plan,
        arrays=(*plan.arrays, ARRAY),
        sets=tuple((number, *held) for held in plan.sets),
        maps=plan.maps + np.uint32(UNITS),
        reached=np.where(plan.reached, plan.reached << np.uint32(UNITS) | np.uint32(1), np.uint32(0)),
    )


def readers(found: Sequence[Use]) -> dict[Key, list[int]]:
    """Return the materials that read each image."""
    made: dict[Key, list[int]] = {}
    for use in found:
        made.setdefault(use.read.key, []).append(use.material)
    return made


def layer_uses(plan: ArrayPlan, found: Sequence[Use]) -> dict[tuple[int, int], list[Use]]:
    """Return who samples which layer, by (number of the array, layer)."""
    made: dict[tuple[int, int], list[Use]] = {}
    for use in found:
        value = int(plan.maps[use.material, use.role])
        array = plan.sets[plan.set_of[use.material]][value & (1 << LAYER_SHIFT) - 1]
        made.setdefault((array, value >> LAYER_SHIFT), []).append(use)
    return made
