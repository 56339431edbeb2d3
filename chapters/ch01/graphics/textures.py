"""Textures of a scene: each image that some material reads is uploaded once for each way in which it is read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import Image, mip_levels
from backends.vulkan.upload import Uploader
from common.color import decode_srgb
from common.pools import Handle
from common.scene import Scene, TextureRef

from .resources import Resources

_NEUTRAL = {
    # What a role without a texture would have to sample for the picture to stay the same.
    "base_color": (1.0, 1.0, 1.0, 1.0),
    "metallic_roughness": (1.0, 1.0, 1.0, 1.0),
    "normal": (0.5, 0.5, 1.0, 1.0),
    "occlusion": (1.0, 1.0, 1.0, 1.0),
    "emissive": (1.0, 1.0, 1.0, 1.0),
}


def half_texels(pixels: np.ndarray, srgb: bool) -> np.ndarray:
    """Return (H, W, 4) uint16 or float texels as float16 light; sRGB codes of integers are decoded.

    What is not finite is made so here: a filter would spread one NaN over every smaller mip level.
    """
    if pixels.dtype == np.uint16:
        value = pixels.astype(np.float32) / np.float32(65535.0)
        if srgb:
            value[..., :3] = decode_srgb(value[..., :3])
    else:
        value = np.nan_to_num(pixels.astype(np.float32), nan=0.0, posinf=65504.0, neginf=-65504.0)
    return np.clip(value, -65504.0, 65504.0).astype(np.float16)


class Textures:
    """The images on the GPU, by what is read: which image, as colour (sRGB) or as data, with or without mip levels."""

    def __init__(self, scene: Scene, resources: Resources) -> None:
        self._scene, self._resources = scene, resources
        self._images: dict[tuple[Any, ...], Handle] = {}

    def __len__(self) -> int:
        return len(self._images)

    @staticmethod
    def key(role: str, texture: TextureRef | None) -> tuple[Any, ...]:
        """Return what is uploaded for `texture` in `role`; without one, what leaves the picture as it is."""
        if texture is None:
            return ("neutral", _NEUTRAL[role])
        return (
            "image",
            texture.image,
            role in ("base_color", "emissive"),
            texture.sampler.mipmap is not None,
        )

    def get(self, role: str, texture: TextureRef | None) -> Image:
        """Return the image that `texture` in `role` reads."""
        return self._resources.images.get(self._images[self.key(role, texture)])

    def keep(self, uploader: Uploader, used: Iterable[tuple[str, TextureRef | None]]) -> None:
        """Upload what is missing for (role, texture) in `used`, and give up what is not in it."""
        wanted = {self.key(role, texture): role for role, texture in used}
        for key, role in wanted.items():
            if key not in self._images:
                self._images[key] = self._upload(uploader, role, key)
        for key in self._images.keys() - wanted.keys():
            self._resources.destroy_image(self._images.pop(key))

    def _upload(self, uploader: Uploader, role: str, key: tuple[Any, ...]) -> Handle:
        usage = (
            vk.VK_IMAGE_USAGE_SAMPLED_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        )
        if key[0] == "neutral":
            handle = self._resources.image("rgba16f", (1, 1), usage, f"neutral {role}")
            pixels = np.array(key[1], np.float16).reshape(1, 1, 4)
            uploader.image(self._resources.images.get(handle), pixels)
            return handle
        _, number, srgb, mipmapped = key
        image = self._scene.images[number]
        height, width = image.pixels.shape[:2]
        levels = mip_levels(width, height) if mipmapped else 1
        if levels > 1:
            usage |= vk.VK_IMAGE_USAGE_STORAGE_BIT
        pixels = image.pixels
        if pixels.dtype != np.uint8:
            # Sixteen bits do not fit into eight; half precision keeps eleven of them and is filtered everywhere.
            value = half_texels(pixels, srgb)
            handle = self._resources.image("rgba16f", (width, height), usage, image.name, levels=levels)
            uploader.image(self._resources.images.get(handle), value)
            return handle
        handle = self._resources.image(
            "rgba8",
            (width, height),
            usage,
            image.name,
            levels=levels,
            view_format="rgba8_srgb" if srgb else None,
        )
        uploader.image(self._resources.images.get(handle), pixels, srgb=srgb)
        return handle
