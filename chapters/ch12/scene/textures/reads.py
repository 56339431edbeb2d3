"""Which textures the materials of a scene sample, each named once: an image as it is read, with its sampler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.scene import Sampler, Scene

from ..packing import ROLES, Variant
from . import texels

MAPS = 8
"""Numbers of textures in a material's record: one a role, and room up to the next multiple of 16 bytes."""


@dataclass(frozen=True)
class Read:
    """A texture as a shader samples it."""

    key: texels.Key
    sampler: Sampler


class Use(NamedTuple):
    """Role number `role` of a material samples `read`."""

    material: int
    role: int
    read: Read


def uses(scene: Scene, variants: Sequence[Variant], narrow: bool = True) -> list[Use]:
    """Return everything that some variant samples, in the order of the materials.

    Channels of an image that no material reads are left out: the image is smaller and looks the same. Unless
    `narrow` is False: some devices write mip levels of four channels only.
    """
    sampled: list[tuple[int, str, texels.Key, Sampler]] = []
    channels: dict[texels.Key, set[str]] = {}
    for number, (material, variant) in enumerate(zip(scene.materials, variants, strict=True)):
        textures = material.textures()
        for role in variant.roles:
            texture = textures.get(role)
            sampler = Sampler() if texture is None else texture.sampler
            key = texels.key_of(role, texture)
            channels.setdefault(key, set()).update(texels.READ.get(role, "rgba"))
            sampled.append((number, role, key, sampler))

    def whole(key: texels.Key) -> texels.Key:
        if key[0] == "neutral":
            return key
        return (*key, "".join(letter for letter in "rgba" if letter in channels[key] or not narrow))

    keys = {key: whole(key) for key in channels}
    return [
        Use(number, ROLES.index(role), Read(keys[key], sampler)) for number, role, key, sampler in sampled
    ]


def image_roles(uses: Sequence[Use]) -> dict[texels.Key, str]:
    """Return the images that are read, each with a role in which it is."""
    images: dict[texels.Key, str] = {}
    for use in uses:
        images.setdefault(use.read.key, ROLES[use.role])
    return images


def empty_maps(materials: int) -> np.ndarray:
    """Return (materials, MAPS) uint32 of texture 0, which is the dummy where textures have slots."""
    return np.zeros((materials, MAPS), np.uint32)
