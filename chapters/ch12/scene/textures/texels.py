"""What is uploaded for a texture: which image, in which format, with how many mip levels."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from common.errors import SceneError
from common.images import blocks
from common.images.color import decode_srgb
from common.scene import Scene, TextureRef
from common.scene.images import Chain, Image

NEUTRAL = {
    # What a role without a texture would have to sample for the picture to stay the same.
    "base_color": (1.0, 1.0, 1.0, 1.0),
    "metallic_roughness": (1.0, 1.0, 1.0, 1.0),
    "normal": (0.5, 0.5, 1.0, 1.0),
    "occlusion": (1.0, 1.0, 1.0, 1.0),
    "emissive": (1.0, 1.0, 1.0, 1.0),
}

Key = tuple[Any, ...]
"""Equal keys are one image on the GPU: the scene's image, as colour (sRGB) or as data, with or without mip levels.

`reads` also has the channels that materials read.
"""

READ = {"metallic_roughness": "gb", "occlusion": "r"}
"""The channels that a role reads, where it does not read colour."""

NARROW = {"r": ("r8", "r001", [0]), "gb": ("rg8", "0rg1", [1, 2])}
"""Channels that are read -> (format that holds no others, how it is seen, which columns of the pixels it holds)."""


@dataclass(frozen=True, eq=False)
class Texels:
    """Pixels (H, W, C) of level 0 as the GPU takes them. `view_format` is how they are sampled, if otherwise."""

    name: str
    pixels: np.ndarray
    format: str
    view_format: str | None
    levels: int
    srgb: bool  # whether mip levels average the light that the codes stand for
    swizzle: str = "rgba"


class Shape(NamedTuple):
    """The properties that images share as layers of one array: size, formats, levels; see `Texels`."""

    width: int
    height: int
    format: str
    view_format: str | None
    levels: int
    swizzle: str = "rgba"


def shape_of(scene: Scene, key: Key, features: Collection[str] | None = None) -> Shape:
    """Return the shape of the pixels that `texels_of` returns for `key`, or with `features` of its chain."""
    if key[0] == "neutral":
        return Shape(1, 1, "rgba16f", None, 1)
    _, number, srgb, mipmapped, channels = key
    image = scene.images[number]
    width, height = image.width, image.height
    chain = chain_of(scene, key, features) if features is not None else None
    if chain is not None:
        return Shape(width, height, chain.format, chain.view_format, len(chain.levels), chain.swizzle)
    levels = max(height, width).bit_length() if mipmapped else 1
    if image.dtype != np.uint8:
        # Sixteen bits do not fit into eight; half precision keeps eleven of them and is filtered everywhere.
        return Shape(width, height, "rgba16f", None, levels)
    if channels in NARROW:
        format, swizzle, _ = NARROW[channels]
        return Shape(width, height, format, None, levels, swizzle)
    return Shape(width, height, "rgba8", "rgba8_srgb" if srgb else None, levels)


def chain_of(scene: Scene, key: Key, features: Collection[str]) -> Chain | None:
    """Return the mip levels that an image has ready for `key`; None where its pixels are to be decoded.

    So they are where the device, whose optional `features` these are, cannot sample the chain's format.
    """
    if key[0] == "neutral":
        return None
    _, number, srgb, mipmapped, channels = key
    chain = scene.images[number].chain(srgb, mipmapped, channels)
    lacks = chain is not None and blocks.storage_of(chain.format, features) != chain.format
    return None if lacks else chain


def key_of(role: str, texture: TextureRef | None) -> Key:
    """Return what is uploaded for `texture` in `role`; without one, a texel that changes nothing."""
    if texture is None:
        return ("neutral", NEUTRAL[role])
    return ("image", texture.image, role in ("base_color", "emissive"), texture.sampler.mipmap is not None)


def name_of(scene: Scene, key: Key) -> str:
    """Return how messages call what is uploaded for `key`."""
    return "neutral" if key[0] == "neutral" else f"image {key[1]} ('{scene.images[key[1]].name}')"


def check_images(scene: Scene, largest: int) -> None:
    """Raise SceneError if a material reads an image that is not there, or one whose sides are not 1 to `largest`."""
    count = len(scene.images)
    for number, material in enumerate(scene.materials):
        for role, texture in material.textures().items():
            if not 0 <= texture.image < count:
                raise SceneError(
                    f"Material {number} reads image {texture.image} as its {role}, but there are {count} images, "
                    "counted from 0: name one of them in the edit."
                )
            image = scene.images[texture.image]
            height, width = image.height, image.width
            if not 1 <= min(width, height) <= max(width, height) <= largest:
                mend = (
                    f"make it smaller: this device takes no side longer than {largest}"
                    if min(width, height)
                    else "give it one pixel at least"
                )
                raise SceneError(
                    f"Image {texture.image} ('{image.name}') has {width}x{height} pixels, and material {number} reads "
                    f"it as its {role}: {mend}."
                )


def texels_of(scene: Scene, role: str, key: Key, mended: bool = True) -> Texels:
    """Return the pixels for `key`, which some texture in `role` has; see `half_texels` for `mended`."""
    if key[0] == "neutral":
        pixels = np.array(key[1], np.float16).reshape(1, 1, 4)
        return Texels(f"neutral {role}", pixels, "rgba16f", None, 1, False)
    _, number, srgb, _, channels = key
    image, shape = scene.images[number], shape_of(scene, key)
    if image.dtype != np.uint8:
        half = half_texels(image.decode(), srgb, mended)
        return Texels(image.name, half, shape.format, None, shape.levels, False)
    held = image.decode()[..., NARROW[channels][2]] if channels in NARROW else image.decode()
    return Texels(image.name, held, shape.format, shape.view_format, shape.levels, srgb, shape.swizzle)


def array_name(layers: Sequence[Texels | Image]) -> str:
    """Return the name of an array texture: that of its first layer, and how many there are besides."""
    more = len(layers) - 1
    return layers[0].name + (f" and {more} more" if more else "")


def half_texels(pixels: np.ndarray, srgb: bool, mended: bool = True) -> np.ndarray:
    """Return (H, W, 4) uint16 or float texels as float16 light; sRGB codes of integers are decoded.

    What is not finite is made so here: a filter would spread one NaN over every smaller mip level. Unless `mended`: the
    view `non-finite` is there to find it.
    """
    if pixels.dtype == np.uint16:
        value = pixels.astype(np.float32) / np.float32(65535.0)
        if srgb:
            value[..., :3] = decode_srgb(value[..., :3])
    elif not mended:
        with np.errstate(over="ignore"):
            return pixels.astype(np.float16)
    else:
        value = np.nan_to_num(pixels.astype(np.float32), nan=0.0, posinf=65504.0, neginf=-65504.0)
    return np.clip(value, -65504.0, 65504.0).astype(np.float16)
