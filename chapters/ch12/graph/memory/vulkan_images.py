"""The images and buffers of a compiled frame graph, in the memory that the graph planned for them.

Transients exist once for both frames in flight: frames run in order on the queue, and the first use of each transient
waits for its last use in the previous frame. A history has two images, which swap with every frame. So each of the two
slots always has the same image as its current image.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.memory import Allocation
from backends.vulkan.resources import (
    Buffer,
    Image,
    buffer_requirements,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    image_requirements,
)

from ...frames.frame import SLOTS
from ..frame_graph import texels
from ..types import Graph, Requirement, Resource
from .images import ImagesInSlots

_IMAGE_USAGE: dict[str, int] = {
    "color": vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
    "depth": vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
    "sampled": vk.VK_IMAGE_USAGE_SAMPLED_BIT,
    "storage": vk.VK_IMAGE_USAGE_STORAGE_BIT,
    "rate": vk.VK_IMAGE_USAGE_FRAGMENT_SHADING_RATE_ATTACHMENT_BIT_KHR,
    "copy_source": vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
    "copy_target": vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT,
}
_BUFFER_USAGE: dict[str, int] = {
    "storage": vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
    "uniform": vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT,
    "indirect": vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT,
    "copy_source": vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
    "copy_target": vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT,
}


class GraphMemory:
    """The usage flags of resources, and their memory requirements for the compiler.

    `also` are additional uses, such as writes of a test. The queue `families` share the buffers.
    """

    def __init__(self, device: Device, also: Collection[str] = (), families: tuple[int, ...] = ()) -> None:
        self._device, self._also, self.families = device, frozenset(also), families
        self._known: dict[Any, Requirement] = {}

    def usage(self, resource: Resource) -> int:
        """Return the usage flags of a resource."""
        flags = _BUFFER_USAGE if resource.kind == "buffer" else _IMAGE_USAGE
        also = set(self._also)
        if resource.life in ("kept", "history") and resource.samples == 1:  # an inspection may copy it
            also.add("copy_source")
        return sum(flag for use, flag in flags.items() if use in resource.uses | also)

    def requirement(self, resource: Resource) -> Requirement:
        """Return the memory requirements of a resource before it exists."""
        usage = self.usage(resource)
        shape = resource.size, resource.slices, resource.bytes, resource.samples
        key = (resource.kind, resource.format, shape, usage)
        if key not in self._known:
            if resource.kind == "buffer":
                values = buffer_requirements(self._device, resource.bytes, usage, self.families)
            else:
                assert resource.format is not None and resource.size is not None, resource
                values = image_requirements(
                    self._device,
                    resource.format,
                    resource.size,
                    usage,
                    resource.samples,
                    resource.slices or None,
                )
            padding = max(0, values[0] - texels(resource).size)
            self._known[key] = Requirement(*values, padding)
        return self._known[key]


Held = Mapping[str, Image | Buffer]
Lender = ImagesInSlots[Image, Buffer] | None


class GraphImages(ImagesInSlots[Image, Buffer]):
    """The images and buffers of a graph; its histories may be those of a `lender`."""

    kind = Image

    def __init__(
        self, device: Device, graph: Graph, memory: GraphMemory, externals: Held, lender: Lender = None
    ) -> None:
        self._device, self._memory, self.graph, self._lender = device, memory, graph, lender
        self._heaps: list[Allocation] = []
        self._objects: list[Image | Buffer] = []
        self.in_slot: list[dict[str, Image | Buffer]] = [dict(externals) for _ in range(SLOTS)]
        try:
            buffers = {
                place.heap
                for name, place in graph.memory.places.items()
                if graph.resources[name].kind == "buffer"
            }
            for number, heap in enumerate(graph.memory.heaps):
                needs = vk.new(
                    "VkMemoryRequirements",
                    size=heap.size,
                    alignment=heap.alignment,
                    memoryTypeBits=heap.types,
                )
                self._heaps.append(device.memory.allocate(needs, "device", linear=number in buffers))
            for resource in graph.resources.values():
                self._make(graph, resource)
        except BaseException:
            self.close()
            raise

    def _make(self, graph: Graph, resource: Resource) -> None:
        name = resource.name
        if resource.life == "external":
            return
        if resource.life == "history":
            self._add_history(resource, self._lender, self._create)
            return
        place = graph.memory.places.get(name)
        where = None
        if place is not None:
            heap = self._heaps[place.heap]
            where = heap.memory, heap.offset + place.offset
        image_or_buffer = self._create(resource, name, where)
        for resources in self.in_slot:
            resources[name] = image_or_buffer

    def _create(self, resource: Resource, name: str, place: tuple[Any, int] | None = None) -> Image | Buffer:
        image_or_buffer: Image | Buffer
        usage = self._memory.usage(resource)
        if resource.kind == "buffer":
            image_or_buffer = create_buffer(
                self._device, resource.bytes, usage, "device", name, place, self._memory.families
            )
        else:
            assert resource.format is not None and resource.size is not None, resource
            image_or_buffer = create_image(
                self._device,
                resource.format,
                resource.size,
                usage,
                name,
                samples=resource.samples,
                depth=resource.slices or None,
                place=place,
            )
        self._objects.append(image_or_buffer)
        return image_or_buffer

    def close(self) -> None:
        """Free all images and buffers; no frame is in flight."""
        for image_or_buffer in self._objects:
            if isinstance(image_or_buffer, Image):
                destroy_image(self._device, image_or_buffer)
            else:
                destroy_buffer(self._device, image_or_buffer)
        self._objects = []
        for heap in self._heaps:
            self._device.memory.free(heap)
        self._heaps = []
