"""Placeholders: one neutral texel that materials sample until their textures have arrived.

White is neutral for every texture that is multiplied with a factor, which is every texture except normal maps. There
the neutral texel is the normal that points straight up.
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
"""The kinds of placeholders by role; a material only needs the number of a role's placeholder."""

ARRAY = ArrayTexture(
    Shape(1, 1, "rgba16f", None, 1), Sampler(), tuple(("neutral", value) for value in _VALUES)
)
"""All placeholders as the layers of one array texture."""

UNITS = 1
"""The number of arrays of a set that hold placeholders: the first one."""


def of_role(role: int) -> int:
    """Return the value in a material's record for the placeholder of a role, in a plan of `with_placeholders`."""
    return _VALUES.index(NEUTRAL[ROLES[role]]) << LAYER_SHIFT


def with_placeholders(plan: ArrayPlan) -> ArrayPlan:
    """Return a plan in which `ARRAY` is the first array of each set, so that every role can sample it."""
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


def readers(uses: Sequence[Use]) -> dict[Key, list[int]]:
    """Return the materials that read each image."""
    materials: dict[Key, list[int]] = {}
    for use in uses:
        materials.setdefault(use.read.key, []).append(use.material)
    return materials


def layer_uses(plan: ArrayPlan, uses: Sequence[Use]) -> dict[tuple[int, int], list[Use]]:
    """Return the uses of each layer, by (number of the array, layer)."""
    by_layer: dict[tuple[int, int], list[Use]] = {}
    for use in uses:
        value = int(plan.maps[use.material, use.role])
        array = plan.sets[plan.set_of[use.material]][value & (1 << LAYER_SHIFT) - 1]
        by_layer.setdefault((array, value >> LAYER_SHIFT), []).append(use)
    return by_layer
