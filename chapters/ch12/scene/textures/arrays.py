"""Textures without bindless: images of one size, format and sampler become layers of one array texture.

A shader reaches a fixed number of arrays. Where a scene has more of them, its materials fall into sets, each with its
own choice of arrays; draws are grouped by set. A material samples five textures at most, and so fits into one.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from common.scene import Sampler, Scene

from ..packing import ROLES
from . import texels
from .reads import Read, Use, empty_maps
from .texels import Key, Shape

ARRAYS = 13
"""Array textures that a shader can reach: 16 samplers, which every device has, without the environment's three."""

LAYER_SHIFT = 8
"""In a material's record a texture is the number of its array in the set, and above it the layer; see textures.glsl."""


@dataclass(frozen=True)
class ArrayTexture:
    """One array: what all of its layers have in common, and which image each of them is."""

    shape: Shape
    sampler: Sampler
    layers: tuple[Key, ...]


@dataclass(frozen=True, eq=False)
class ArrayPlan:
    """`sets` are numbers of `arrays`; `set_of` (M,) is the set of each material, `maps` what its record says.

    `reached` (M, roles) uint32 has for each material and role the bit of the array, as numbered in the sets, that it
    samples.
    """

    arrays: tuple[ArrayTexture, ...]
    sets: tuple[tuple[int, ...], ...]
    set_of: np.ndarray
    maps: np.ndarray
    reached: np.ndarray

    @property
    def width(self) -> int:
        """Arrays of the largest set: how many the shaders are built for."""
        return max((len(held) for held in self.sets), default=0)

    def defines(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        """What shaders of these materials are built with: how many arrays there are, which of them a role samples."""
        bits = np.bitwise_or.reduce(self.reached[materials], axis=0).tolist()
        masks = ", ".join(f"{mask}u" for mask in bits)
        return ("ARRAYS", self.width), ("ROLE_ARRAYS", f"uint[{len(bits)}]({masks})")


def plan_arrays(
    scene: Scene, uses: Sequence[Use], max_layers: int, width: int = ARRAYS, features: Collection[str] = ()
) -> ArrayPlan:
    """Return which textures lie together; an array has at most `max_layers` layers, a set at most `width` arrays."""
    layers: dict[tuple[Shape, Sampler, int], list[Key]] = {}
    parts: dict[tuple[Shape, Sampler], int] = {}
    place: dict[Read, tuple[tuple[Shape, Sampler, int], int]] = {}
    for use in uses:
        if use.read in place:
            continue
        kind = (texels.shape_of(scene, use.read.key, features), use.read.sampler)
        part = parts.setdefault(kind, 0)
        if len(layers.get((*kind, part), ())) == max_layers:
            part = parts[kind] = part + 1
        held = layers.setdefault((*kind, part), [])
        place[use.read] = ((*kind, part), len(held))
        held.append(use.read.key)
    numbers = {kind: number for number, kind in enumerate(layers)}
    arrays = tuple(ArrayTexture(shape, sampler, tuple(held)) for (shape, sampler, _), held in layers.items())

    needed: dict[int, list[int]] = {}
    for use in uses:
        needed.setdefault(use.material, []).append(numbers[place[use.read][0]])
    sets: list[list[int]] = [[]]
    set_of = np.zeros(len(scene.materials), np.int64)
    for material, wanted in needed.items():
        # The first set with room for what is missing; most scenes need only one.
        room = (number for number, held_arrays in enumerate(sets) if len({*held_arrays, *wanted}) <= width)
        number = next(room, len(sets))
        if number == len(sets):
            sets.append([])
        sets[number] += [array for array in dict.fromkeys(wanted) if array not in sets[number]]
        set_of[material] = number
    maps = empty_maps(len(scene.materials))
    reached = np.zeros((len(scene.materials), len(ROLES)), np.uint32)
    for use in uses:
        kind_part, layer = place[use.read]
        unit = sets[set_of[use.material]].index(numbers[kind_part])
        maps[use.material, use.role] = unit | layer << LAYER_SHIFT
        reached[use.material, use.role] = 1 << unit
    return ArrayPlan(arrays, tuple(tuple(held) for held in sets), set_of, maps, reached)
