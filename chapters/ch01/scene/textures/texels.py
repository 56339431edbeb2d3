"""What is uploaded for a texture: which image, in which format, with how many mip levels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from common.errors import SceneError
from common.images.color import decode_srgb
from common.scene import Scene, TextureRef

NEUTRAL = {
    # What a role without a texture would have to sample for the picture to stay the same.
    "base_color": (1.0, 1.0, 1.0, 1.0),
    "metallic_roughness": (1.0, 1.0, 1.0, 1.0),
    "normal": (0.5, 0.5, 1.0, 1.0),
    "occlusion": (1.0, 1.0, 1.0, 1.0),
    "emissive": (1.0, 1.0, 1.0, 1.0),
}

Key = tuple[Any, ...]
"""Equal keys are one image on the GPU: the scene's image, as colour (sRGB) or as data, with or without mip levels."""


@dataclass(frozen=True, eq=False)
class Texels:
    """Pixels (H, W, 4) of level 0 as the GPU takes them. `view_format` is how they are sampled, if otherwise."""

    name: str
    pixels: np.ndarray
    format: str
    view_format: str | None
    levels: int
    srgb: bool  # whether mip levels average the light that the codes stand for


def key_of(role: str, texture: TextureRef | None) -> Key:
    """Return what is uploaded for `texture` in `role`; without one, a texel that changes nothing."""
    if texture is None:
        return ("neutral", NEUTRAL[role])
    return ("image", texture.image, role in ("base_color", "emissive"), texture.sampler.mipmap is not None)


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
    _, number, srgb, mipmapped = key
    image = scene.images[number]
    levels = max(image.width, image.height).bit_length() if mipmapped else 1
    if image.dtype != np.uint8:
        # Sixteen bits do not fit into eight; half precision keeps eleven of them and is filtered everywhere.
        return Texels(image.name, half_texels(image.pixels, srgb, mended), "rgba16f", None, levels, False)
    return Texels(image.name, image.pixels, "rgba8", "rgba8_srgb" if srgb else None, levels, srgb)


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
