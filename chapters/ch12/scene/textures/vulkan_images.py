"""Textures of a scene: each image that some material reads is uploaded once for each way in which it is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Image
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle
from common.scene import Scene

from ...frames.vulkan_resources import Resources
from ...loading.loading import Loading, Request, Wanted
from ...loading.uploads import upload_bytes, upload_of
from ...loading.vulkan import Loader
from ...loading.vulkan_copies import Target
from . import texels

_USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
)


class Textures:
    """The images on the GPU, by what is read: which image, as colour (sRGB) or as data, with or without mip levels.

    Without `mended`, texels that are no finite numbers stay what they are.
    """

    def __init__(
        self, device: Device, scene: Scene, resources: Resources, mended: bool, loading: Loading
    ) -> None:
        self._scene, self._resources, self._mended = scene, resources, mended
        self._features = device.features
        self._images: dict[texels.Key, Handle] = {}
        self._placed: dict[Request, Handle] = {}
        self.loader = Loader(device, self, loading, own_queue=True)

    def __len__(self) -> int:
        return len(self._images)

    def __contains__(self, key: texels.Key) -> bool:
        return key in self._images

    def get(self, key: texels.Key) -> Image:
        """Return the image that is read as `key` says."""
        return self._resources.images.get(self._images[key])

    def keep(
        self,
        uploader: Uploader,
        wanted: Mapping[texels.Key, str],
        readers: Mapping[texels.Key, Sequence[int]],
    ) -> None:
        """Begin to load what is missing of `wanted`, images with a role that reads them, and give up the others.

        `readers` are the materials that read each image.
        """
        for key, role in wanted.items():
            if key[0] == "neutral" and key not in self._images:
                self._images[key] = self._upload(uploader, role, key)
        self.loader.want(
            {
                key: Wanted(
                    texels.name_of(self._scene, key),
                    upload_bytes(self._scene, key),
                    partial(upload_of, self._scene, role, key, self._mended, self._features),
                    readers.get(key, ()),
                )
                for key, role in wanted.items()
                if key[0] != "neutral"
            }
        )
        shapes = [texels.shape_of(self._scene, key) for key in wanted]
        self.loader.prepare({(shape.format, False) for shape in shapes if shape.levels > 1})
        for key in self._images.keys() - wanted.keys():
            self._resources.destroy_image(self._images.pop(key))

    def update(self, budget: int | None) -> list[texels.Key]:
        """Go on loading; return what has arrived. None: load everything, and wait for it; raises as `Loader.finish`."""
        return self._arrive(self.loader.finish() if budget is None else self.loader.advance(budget))

    def _arrive(self, requests: Sequence[Request]) -> list[texels.Key]:
        arrived: list[texels.Key] = []
        for request in requests:
            assert isinstance(request.key, tuple)
            self._images[request.key] = self._placed.pop(request)
            arrived.append(request.key)
        return arrived

    def place(self, request: Request) -> Target:
        """Make the image of a texture that was decoded."""
        assert request.upload is not None, "what is decoded has pixels"
        shape = request.upload.shape
        made_here = len(request.upload.rows) < shape.levels
        handle = self._resources.image(
            shape.format,
            (shape.width, shape.height),
            _USAGE | (vk.VK_IMAGE_USAGE_STORAGE_BIT if made_here else 0),
            request.upload.name,
            levels=shape.levels,
            view_format=shape.view_format,
            swizzle=shape.swizzle,
        )
        self._placed[request] = handle
        return Target(self._resources.images.get(handle))

    def discard(self, request: Request) -> None:
        """Free the image of a cancelled texture."""
        self._resources.destroy_image(self._placed.pop(request))

    def _upload(self, uploader: Uploader, role: str, key: texels.Key) -> Handle:
        image = texels.texels_of(self._scene, role, key)
        handle = self._resources.image(image.format, (1, 1), _USAGE, image.name)
        uploader.image(self._resources.images.get(handle), image.pixels)
        return handle
