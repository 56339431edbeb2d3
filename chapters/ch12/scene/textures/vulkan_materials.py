"""The textures of the materials on the GPU: slots of the bindless set, or layers of array textures without it.

Both say the same of a scene: `maps`, the number of each material's textures as its record holds it, and `set_of`, which
of `sets` has to be bound to draw it. With bindless that is one set for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, cast

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.device import Device
from backends.vulkan.driver.features import CORE
from backends.vulkan.once import submit_once
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle
from common.scene import Scene

from ...frames.vulkan_resources import Resources
from ...loading import placeholders
from ...loading.array_arrivals import ArrayArrivals, array_name
from ...loading.loading import Loading, Request
from ...loading.vulkan import Loader
from ...loading.vulkan_copies import Target
from ...pipelines.vulkan_descriptors import Descriptors, Sets, Texture
from ...pipelines.vulkan_layouts import SetLayout
from ..packing import ROLES, Variant
from . import texels
from .arrays import ArrayPlan, ArrayTexture
from .reads import Read, Use, empty_maps, image_roles, uses
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

    def update(self, budget: int | None) -> int:
        """Go on loading, and write what changed, before a frame is recorded; return how many descriptors that were.

        `budget` are the bytes that may be copied; None: everything, which is waited for.
        """

    @property
    def revision(self) -> int:
        """Grows when `maps` change between edits, since textures have arrived."""

    @property
    def loader(self) -> Loader:
        """What loads them."""

    def close(self) -> None:
        """Free the objects that the resources do not own."""


def takes_narrow(device: Device) -> bool:
    """Whether mip levels of one and two channels can be made."""
    return (CORE, "shaderStorageImageExtendedFormats") in device.physical.bits


def slots_for(scene: Scene, variants: Sequence[Variant]) -> int:
    """Return how many slots a scene is given: twice what it needs, since edits add more, and FIRST_SLOTS at least."""
    needed = len({use.read for use in uses(scene, variants)}) + 1 + len(placeholders.READS)
    return max(FIRST_SLOTS, 2 * needed)


class BindlessTextures:
    """One image for each way in which it is read, one slot for each sampler that reads it."""

    def __init__(
        self,
        device: Device,
        scene: Scene,
        resources: Resources,
        anisotropy: float,
        mended: bool,
        slots: int,
        loading: Loading,
    ) -> None:
        self._device, self._scene, self._resources = device, scene, resources
        self._anisotropy, self._slot_count = anisotropy, slots
        self._narrow = takes_narrow(device)
        self._textures = Textures(device, scene, resources, mended, loading)
        self._streams, self.revision = loading.streams, 0
        self._expected: dict[texels.Key, list[Use]] = {}
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
        standing = [Use(0, ROLES.index(role), read) for role, read in placeholders.READS.items()]
        sampled = [*own, *(standing if self._streams and own else ())]
        self._textures.keep(uploader, image_roles(sampled), placeholders.readers(own))
        wanted = {use.read: self._resources.sampler(use.read.sampler, self._anisotropy) for use in sampled}
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
            if read not in self._slots and read.key in self._textures:
                self._slots[read] = self.bindless.add(self._textures.get(read.key).view, sampler)
        self._expected = {}
        for use in own:
            if use.read not in self._slots:
                self._expected.setdefault(use.read.key, []).append(use)
            there = use.read if use.read in self._slots else placeholders.READS[ROLES[use.role]]
            if there in self._slots:  # else no frame is drawn before all have arrived
                self.maps[use.material, use.role] = self._slots[there]

    def make_sets(self, layout: SetLayout | None) -> None:
        """Make the one set."""
        if layout is not None and self.bindless is not None:
            self.bindless.create(layout)
            self.sets = [self.bindless.sets]

    @property
    def loader(self) -> Loader:
        """What loads the images."""
        return self._textures.loader

    def update(self, budget: int | None) -> int:
        """Give slots to what has arrived, and write those that were given out since the last frame."""
        for key in self._textures.update(budget):
            for use in self._expected.pop(key, ()):
                self._arrive(use)
            self.revision += 1
        return self.bindless.update() if self.bindless is not None else 0

    def _arrive(self, use: Use) -> None:
        # Never the placeholder's slot with another image in it: frames in flight read that one.
        read = use.read
        if read not in self._slots:
            assert self.bindless is not None, "what is expected is read"
            sampler = self._resources.sampler(read.sampler, self._anisotropy)
            self._slots[read] = self.bindless.add(self._textures.get(read.key).view, sampler)
        self.maps[use.material, use.role] = self._slots[read]

    def close(self) -> None:
        """Free the set, and stop loading."""
        self.loader.stop()
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
        loading: Loading,
    ) -> None:
        self._scene, self._resources, self._descriptors = scene, resources, descriptors
        self._device, self._anisotropy, self._loading = device, anisotropy, loading
        self._arrivals = ArrayArrivals(scene, mended, loading.streams, device.features)
        # Layers change while frames sample others of the same image: that stays with the queue that draws.
        self.loader = Loader(device, self, loading, own_queue=False)
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
        plan = self._plan = self._arrivals.plan(own, self._max_layers)
        new = [array for array in plan.arrays if array not in self._images]
        for array in new:
            self._images[array] = self._make(uploader, array)
        wanted = self._arrivals.wanted(plan, own, image_roles(own), self._images)
        if self._loading.streams and new:
            self._show(new)
        self.loader.want(wanted)
        self.loader.prepare({(array.shape.format, True) for array in plan.arrays if array.shape.levels > 1})
        for array in self._images.keys() - set(plan.arrays):
            self._resources.destroy_image(self._images.pop(array))
        self.maps, self.set_of = self._arrivals.begin(self._loading.resident), plan.set_of

    def _make(self, uploader: Uploader, array: ArrayTexture) -> Handle:
        shape = array.shape
        made_here = any(
            texels.chain_of(self._scene, key, self._device.features) is None for key in array.layers
        )
        usage = _USAGE | (vk.VK_IMAGE_USAGE_STORAGE_BIT if shape.levels > 1 and made_here else 0)
        handle = self._resources.image(
            shape.format,
            (shape.width, shape.height),
            usage,
            array_name(self._scene, array),
            levels=shape.levels,
            layers=len(array.layers),
            array=True,
            view_format=shape.view_format,
            swizzle=shape.swizzle,
        )
        if array == placeholders.ARRAY:
            layers = [texels.texels_of(self._scene, "placeholder", key).pixels for key in array.layers]
            uploader.image(self._resources.images.get(handle), layers)
        return handle

    def _show(self, arrays: Sequence[ArrayTexture]) -> None:
        """Make new arrays readable as they are: they are bound before their layers arrive."""
        with submit_once(self._device) as commands:
            for array in arrays:
                if array != placeholders.ARRAY:
                    image = self._resources.images.get(self._images[array])
                    transition(self._device, commands, image, "undefined", "sampled")

    def place(self, request: Request) -> Target:
        """Return the layer that a request asks for."""
        handle, layer = cast(tuple[Handle, int], request.key)
        return Target(self._resources.images.get(handle), layer, held=self._loading.streams)

    def discard(self, request: Request) -> None:
        """The layers go with their array."""

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

    def update(self, budget: int | None) -> int:
        """Name what has arrived. Sets do not change between edits, and are made anew with them."""
        for request in self.loader.finish() if budget is None else self.loader.advance(budget):
            self._arrivals.arrive(request.key)
        return 0

    @property
    def revision(self) -> int:
        """How often `maps` have changed between edits."""
        return self._arrivals.revision

    def close(self) -> None:
        """Stop loading; the descriptors and resources free everything."""
        self.loader.stop()
