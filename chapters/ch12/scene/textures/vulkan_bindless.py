"""The one descriptor set that holds every texture: a slot is a number that shaders know, and a queue fills slots.

The set lives as long as the renderer. Its descriptors may be written after it was bound (UPDATE_AFTER_BIND), but never
one that a frame in flight may read: a freed slot is neither written nor reused before those frames have ended. Every
empty slot reads the dummy texture, in glaring colours.
"""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from common.errors import UnsupportedError

from ...frames.vulkan_resources import Resources
from ...pipelines.vulkan_descriptors import Texture
from ...pipelines.vulkan_layouts import SetLayout

DUMMY = np.array([[[255, 0, 255, 255], [0, 0, 0, 255]], [[0, 0, 0, 255], [255, 0, 255, 255]]], np.uint8)
"""Texels of the dummy texture: a chequerboard of magenta and black."""

FIRST_SLOTS = 4096
"""Slots that there are at least, where the device has them: room for what edits add."""

_TEXTURE = vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER
_IMAGE = vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE


class _Slots:
    """Numbers below `count`, the lowest that is free first."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._free: list[int] = []
        self._unused = 0  # from here on no number was ever given out
        self.taken = 0

    def take(self) -> int | None:
        if not self._free and self._unused == self.count:
            return None
        self.taken += 1
        if self._free:
            return heapq.heappop(self._free)
        self._unused += 1
        return self._unused - 1

    def give_back(self, slot: int) -> None:
        self.taken -= 1
        heapq.heappush(self._free, slot)


class Bindless:
    """Slots for `textures` sampled images and `images` storage images; slot 0 of the sampled ones is the dummy.

    The dummy's sampler is the default of textures that come without one. `dummy_image` is the view in
    empty storage slots. `create` creates the set, when a shader has stated its layout; slots can be allocated before.
    """

    def __init__(
        self,
        device: Device,
        resources: Resources,
        textures: int,
        dummy: Texture,
        images: int = 0,
        dummy_image: Any = None,
    ) -> None:
        self._device, self._resources = device, resources
        self._dummy = {"texture": dummy, "image": Texture(dummy_image, vk.NULL)}
        self._slots = {"texture": _Slots(textures), "image": _Slots(images)}
        self._queue: dict[tuple[str, int], Texture] = {}
        self._pool: Any = None
        self.sets: Any = None
        """An array of the one set, as the commands take it; None before `create`."""
        self.written = 0
        """Descriptors that were written so far, the dummies of the beginning left out."""
        self._slots["texture"].take()

    def __len__(self) -> int:
        """Slots in use, the dummy's among them."""
        return sum(slots.taken for slots in self._slots.values())

    def add(self, view: Any, sampler: Any = None) -> int:
        """Return a slot in which shaders find `view`, read through `sampler`, or else through the dummy's.

        It is written by the next `update`. Where no slot is free, this waits for the frames that keep some of those
        that were given up; it raises UnsupportedError when all are taken.
        """
        return self._add(
            "texture", Texture(view, self._dummy["texture"].sampler if sampler is None else sampler)
        )

    def add_image(self, view: Any) -> int:
        """Return a slot in which shaders find `view` as a storage image."""
        return self._add("image", Texture(view, vk.NULL))

    def _add(self, kind: str, held: Texture) -> int:
        slot = self._slots[kind].take()
        if slot is None:
            # What is left was perhaps given up, and frames in flight still read it: then they are waited for.
            self._device.wait_idle()
            self._resources.flush()
            slot = self._slots[kind].take()
        if slot is None:
            raise UnsupportedError(_full(self._device, self._slots[kind].count, kind))
        self._queue[kind, slot] = held
        return slot

    def free(self, slot: int, kind: str = "texture") -> None:
        """Give a slot up; frames in flight still read what it held, later ones the dummy until it has a new owner."""
        self._queue.pop((kind, slot), None)
        self._resources.defer(lambda: self._give_back(kind, slot))

    def _give_back(self, kind: str, slot: int) -> None:
        self._queue[kind, slot] = self._dummy[kind]
        self._slots[kind].give_back(slot)

    def create(self, layout: SetLayout) -> None:
        """Make the set of this layout, with the dummy in every slot; a second time does nothing."""
        if self.sets is not None:
            return
        for binding, room in zip(layout.bindings, layout.counts, strict=True):
            slots = self._slots[binding.kind]
            if slots.taken > room:
                raise UnsupportedError(_full(self._device, room, binding.kind))
            slots.count = min(slots.count, room)
        counts = {kind: slots.count for kind, slots in self._slots.items()}
        self._numbers: dict[str, int] = {binding.kind: binding.number for binding in layout.bindings}
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            flags=vk.VK_DESCRIPTOR_POOL_CREATE_UPDATE_AFTER_BIND_BIT,
            maxSets=1,
            pPoolSizes=[
                {"type": _TEXTURE, "descriptorCount": counts["texture"]},
                {"type": _IMAGE, "descriptorCount": max(1, counts["image"])},
            ],
        )
        self._pool = self._device.create("vkCreateDescriptorPool", info, "bindless")
        # The last binding of a set may be shorter than its layout says: storage images, most often none.
        variable = vk.new(
            "VkDescriptorSetVariableDescriptorCountAllocateInfo", pDescriptorCounts=[counts["image"]]
        )
        allocate = vk.new(
            "VkDescriptorSetAllocateInfo",
            pNext=variable,
            descriptorPool=self._pool,
            pSetLayouts=[layout.handle],
        )
        out = vk.ffi.new("VkDescriptorSet[1]")
        code = self._device.fn.vkAllocateDescriptorSets(self._device.handle, allocate, out)
        vk.check(code, "vkAllocateDescriptorSets", allocate)
        self._device.name("VkDescriptorSet", out[0], "bindless")
        self.sets = out
        self._write([(kind, 0, self._dummy[kind], count) for kind, count in counts.items() if count])

    def update(self) -> int:
        """Write what was queued, before a frame is recorded; return how many descriptors that were."""
        if self.sets is None or not self._queue:
            return 0
        queued, self._queue = self._queue, {}
        self._write([(kind, slot, held, 1) for (kind, slot), held in queued.items()])
        self.written += len(queued)
        return len(queued)

    def _write(self, runs: list[tuple[str, int, Texture, int]]) -> None:
        """Write runs of slots: (kind, first slot, what all of them hold, how many there are)."""
        writes = [
            vk.new(
                "VkWriteDescriptorSet",
                dstSet=self.sets[0],
                dstBinding=self._numbers[kind],
                dstArrayElement=first,
                descriptorCount=count,
                descriptorType=_TEXTURE if kind == "texture" else _IMAGE,
                pImageInfo=_repeated(kind, held, count),
            )
            for kind, first, held, count in runs
        ]
        array = vk.array("VkWriteDescriptorSet", writes)
        self._device.fn.vkUpdateDescriptorSets(self._device.handle, len(writes), array, 0, vk.NULL)

    def close(self) -> None:
        """Free the set; no frame is in flight."""
        if self._pool is not None:
            self._device.destroy("VkDescriptorPool", self._pool)
            self._pool = self.sets = None


def _repeated(kind: str, held: Texture, count: int) -> Any:
    """Return an array of `count` equal descriptors, copied as bytes: there are thousands when a renderer starts."""
    layouts = {"texture": vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL, "image": vk.VK_IMAGE_LAYOUT_GENERAL}
    element = vk.new(
        "VkDescriptorImageInfo", sampler=held.sampler, imageView=held.view, imageLayout=layouts[kind]
    )
    array = vk.ffi.new("VkDescriptorImageInfo[]", count)
    vk.ffi.buffer(array)[:] = bytes(vk.ffi.buffer(element)) * count
    return array


def _full(device: Device, room: int, kind: str) -> str:
    return (
        f"There are more {kind}s than the {room} that one set holds on {device.capabilities.device}: use fewer, or run "
        "with --without bindless."
    )
