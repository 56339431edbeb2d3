"""The textures of the materials on the GPU: slots of the bindless set, or layers of array textures without it.

Both say the same of a scene: `maps`, the number of each material's textures as its record holds it, and `set_of`, which
of `sets` has to be bound to draw it. With bindless that is one set for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.driver.features import CORE
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle
from common.scene import Scene

from ...frames.vulkan_resources import Resources
from ...pipelines.vulkan_descriptors import Descriptors, Sets, Texture
from ...pipelines.vulkan_layouts import SetLayout
from ..packing import Variant
from . import texels
from .arrays import ArrayPlan, ArrayTexture, plan_arrays
from .reads import Read, empty_maps, image_roles, uses
from .vulkan_bindless import DUMMY, FIRST_SLOTS, Bindless
from .vulkan_images import Textures

_USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
)


class MaterialTextures(Protocol):
    """The interface of both ways for the scene's data."""

    maps: np.ndarray
    """(M, MAPS) uint32: what each material's record says of its textures."""
    set_of: np.ndarray
    """(M,) which of `sets` holds a material's textures."""
    sets: list[Any]
    """Arrays of one descriptor set; empty where nothing is textured, or before `make_sets`."""

    def defines(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        """What the shaders of these materials, which have textures, are built with."""

    def __len__(self) -> int:
        """Images that were uploaded."""

    def keep(self, uploader: Uploader, variants: Sequence[Variant]) -> None:
        """Upload what is missing for `variants`, and give up what none of them reads."""

    def make_sets(self, layout: SetLayout | None) -> None:
        """Make the sets; `layout` is what the shaders say of theirs, None where none of them samples a texture."""

    def update(self) -> int:
        """Write what changed, before a frame is recorded; return how many descriptors that were."""

    def close(self) -> None:
        """Free the objects that the resources do not own."""


def takes_narrow(device: Device) -> bool:
    """Whether mip levels of one and two channels can be made."""
    return (CORE, "shaderStorageImageExtendedFormats") in device.physical.bits


def slots_for(scene: Scene, variants: Sequence[Variant]) -> int:
    """Return how many slots a scene is given: twice what it needs, since edits add more, and FIRST_SLOTS at least."""
    needed = len({use.read for use in uses(scene, variants)}) + 1
    return max(FIRST_SLOTS, 2 * needed)


class BindlessTextures:
    """One image for each way in which it is read, one slot for each sampler that reads it."""

    def __init__(
        self, device: Device, scene: Scene, resources: Resources, anisotropy: float, mended: bool, slots: int
    ) -> None:
        self._device, self._scene, self._resources = device, scene, resources
        self._anisotropy, self._slot_count = anisotropy, slots
        self._narrow = takes_narrow(device)
        self._textures = Textures(scene, resources, mended)
        self.bindless: Bindless | None = None
        """None as long as no material samples anything."""
        self._slots: dict[Read, int] = {}
        self.maps = empty_maps(len(scene.materials))
        self.set_of = np.zeros(len(scene.materials), np.int64)
        self.sets: list[Any] = []

    def defines(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        """One array of all textures."""
        return (("BINDLESS", 1),)

    def __len__(self) -> int:
        return len(self._textures)

    def keep(self, uploader: Uploader, variants: Sequence[Variant]) -> None:
        """Give every texture that is sampled a slot, and take back those of the others."""
        own = uses(self._scene, variants, self._narrow)
        self._textures.keep(uploader, image_roles(own))
        wanted = {use.read: self._resources.sampler(use.read.sampler, self._anisotropy) for use in own}
        if self.bindless is None and wanted:
            handle = self._resources.image("rgba8", (2, 2), _USAGE, "dummy texture")
            dummy = self._resources.images.get(handle)
            uploader.image(dummy, DUMMY)
            sampler = next(iter(wanted.values()))  # any will do
            self.bindless = Bindless(
                self._device, self._resources, self._slot_count, Texture(dummy.view, sampler)
            )
        self.maps = empty_maps(len(self._scene.materials))
        if self.bindless is None:
            return
        for read in [read for read in self._slots if read not in wanted]:
            self.bindless.free(self._slots.pop(read))
        for read, sampler in wanted.items():
            if read not in self._slots:
                self._slots[read] = self.bindless.add(self._textures.get(read.key).view, sampler)
        for use in own:
            self.maps[use.material, use.role] = self._slots[use.read]

    def make_sets(self, layout: SetLayout | None) -> None:
        """Make the one set."""
        if layout is not None and self.bindless is not None:
            self.bindless.create(layout)
            self.sets = [self.bindless.sets]

    def update(self) -> int:
        """Write the slots that were given out since the last frame."""
        return self.bindless.update() if self.bindless is not None else 0

    def close(self) -> None:
        """Free the set."""
        if self.bindless is not None:
            self.bindless.close()


class ArrayTextures:
    """Images of one size, format and sampler as layers of an array texture, and a set for each choice of those."""

    def __init__(
        self,
        device: Device,
        scene: Scene,
        resources: Resources,
        descriptors: Descriptors,
        anisotropy: float,
        mended: bool,
    ) -> None:
        self._scene, self._resources, self._descriptors = scene, resources, descriptors
        self._anisotropy, self._mended = anisotropy, mended
        self._max_layers, self._narrow = int(device.limits.maxImageArrayLayers), takes_narrow(device)
        self._images: dict[ArrayTexture, Handle] = {}
        self._plan: ArrayPlan | None = None
        self._made: Sets | None = None
        self.maps = empty_maps(len(scene.materials))
        self.set_of = np.zeros(len(scene.materials), np.int64)
        self.sets: list[Any] = []

    def __len__(self) -> int:
        return sum(len(array.layers) for array in self._images)

    def defines(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        """How many arrays a shader reaches, as many as the scene needs, and in which of them a role has textures."""
        return () if self._plan is None else self._plan.defines(materials)

    def keep(self, uploader: Uploader, variants: Sequence[Variant]) -> None:
        """Make the arrays that are new: one with another layer is another array."""
        own = uses(self._scene, variants, self._narrow)
        plan = self._plan = plan_arrays(self._scene, own, self._max_layers)
        roles = image_roles(own)
        for array in plan.arrays:
            if array not in self._images:
                self._images[array] = self._upload(uploader, array, roles)
        for array in self._images.keys() - set(plan.arrays):
            self._resources.destroy_image(self._images.pop(array))
        self.maps, self.set_of = plan.maps, plan.set_of

    def _upload(self, uploader: Uploader, array: ArrayTexture, roles: dict[texels.Key, str]) -> Handle:
        layers = [texels.texels_of(self._scene, roles[key], key, self._mended) for key in array.layers]
        shape = array.shape
        usage = _USAGE | (vk.VK_IMAGE_USAGE_STORAGE_BIT if shape.levels > 1 else 0)
        handle = self._resources.image(
            shape.format,
            (shape.width, shape.height),
            usage,
            texels.array_name(layers),
            levels=shape.levels,
            layers=len(layers),
            array=True,
            view_format=shape.view_format,
            swizzle=shape.swizzle,
        )
        pixels = [layer.pixels for layer in layers]
        uploader.image(self._resources.images.get(handle), pixels, srgb=layers[0].srgb)
        return handle

    def make_sets(self, layout: SetLayout | None) -> None:
        """Make a set for each choice of arrays; what a choice does not use repeats its first one."""
        old = self._made
        if old is not None:
            self._resources.defer(lambda: self._descriptors.destroy(old))
        self._made, self.sets = None, []
        if layout is None or self._plan is None:
            return
        held = [
            Texture(
                self._resources.images.get(self._images[array]).view,
                self._resources.sampler(array.sampler, self._anisotropy),
            )
            for array in self._plan.arrays
        ]
        number = layout.bindings[0].number
        wanted: list[Any] = []
        for index, chosen in enumerate(self._plan.sets):
            filled = [*chosen, *[chosen[0]] * (self._plan.width - len(chosen))]
            wanted.append((layout, {number: [held[array] for array in filled]}, f"texture arrays {index}"))
        self._made = self._descriptors.create(wanted)
        self.sets = [vk.array("VkDescriptorSet", [handle]) for handle in self._made.handles]

    def update(self) -> int:
        """Nothing changes between edits: sets are made anew with them."""
        return 0

    def close(self) -> None:
        """The descriptors and resources free everything."""
