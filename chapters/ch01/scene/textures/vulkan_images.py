"""Textures of a scene: each image that some material reads is uploaded once for each way in which it is read."""

from __future__ import annotations

from collections.abc import Iterable

from backends.vulkan import api as vk
from backends.vulkan.resources import Image
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle
from common.scene import Scene, TextureRef

from ...frames.vulkan_resources import Resources
from . import texels


class Textures:
    """The images on the GPU, by what is read: which image, as colour (sRGB) or as data, with or without mip levels.

    Without `mended`, texels that are no finite numbers stay what they are.
    """

    def __init__(self, scene: Scene, resources: Resources, mended: bool) -> None:
        self._scene, self._resources, self._mended = scene, resources, mended
        self._images: dict[texels.Key, Handle] = {}

    def __len__(self) -> int:
        return len(self._images)

    def get(self, role: str, texture: TextureRef | None) -> Image:
        """Return the image that `texture` in `role` reads."""
        return self._resources.images.get(self._images[texels.key_of(role, texture)])

    def keep(self, uploader: Uploader, used: Iterable[tuple[str, TextureRef | None]]) -> None:
        """Upload what is missing for (role, texture) in `used`, and give up what is not in it."""
        wanted = {texels.key_of(role, texture): role for role, texture in used}
        for key, role in wanted.items():
            if key not in self._images:
                self._images[key] = self._upload(uploader, role, key)
        for key in self._images.keys() - wanted.keys():
            self._resources.destroy_image(self._images.pop(key))

    def _upload(self, uploader: Uploader, role: str, key: texels.Key) -> Handle:
        image = texels.texels_of(self._scene, role, key, self._mended)
        usage = (
            vk.VK_IMAGE_USAGE_SAMPLED_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        )
        if image.levels > 1:
            usage |= vk.VK_IMAGE_USAGE_STORAGE_BIT
        height, width = image.pixels.shape[:2]
        handle = self._resources.image(
            image.format,
            (width, height),
            usage,
            image.name,
            levels=image.levels,
            view_format=image.view_format,
        )
        uploader.image(self._resources.images.get(handle), image.pixels, srgb=image.srgb)
        return handle
