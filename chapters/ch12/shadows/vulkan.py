"""The memory of shadows on Vulkan: images, barriers around each round, and the set of the kernel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import Buffer, Image, create_view
from backends.vulkan.upload import Uploader

from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands, Rendering
from ..graph.sync.vulkan import layout_of
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Texture
from .lists import ShadowLists
from .memory import NEAREST, TABLES
from .memory import ShadowMemory as _ShadowMemory

_STORAGE = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
)
_AFTER_DRAWS = barriers(
    memory=(vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT, 0, vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, 0)
)


@dataclass
class _Target:
    image: Image
    layers: list[Rendering]
    kept: list[Rendering]
    to_draw: Any
    to_read: Any


class ShadowMemory(_ShadowMemory):
    """Buffers and images of the renderer's resources, which free them."""

    def _create(self) -> None:
        resources = self._backend.resources
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
        self._handles = [
            resources.buffer(self.layout.size, usage, "upload", f"shadows, slot {slot}")
            for slot in range(SLOTS)
        ]
        self.blocks: list[Buffer] = [resources.buffers.get(handle) for handle in self._handles]
        self._images: list[Any] = []
        self._sets: dict[Any, Any] = {}
        self._alive: list[Any] = []
        self._tables: dict[str, Any] = {}
        self._list_sets: Any = None

    @property
    def held_pages(self) -> Texture:
        """The pages as shaders load them and store to them."""
        return Texture(self.pages.view, vk.NULL, layout_of("general", self.pages))

    def _create_target(self, size: int, layers: int) -> _Target:
        resources, device = self._backend.resources, self._backend.device
        usage = vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT | vk.VK_IMAGE_USAGE_SAMPLED_BIT
        name = f"shadow faces of {size}"
        handle = resources.image("d32f", (size, size), usage, name, layers=layers, array=True)
        self._images.append(handle)
        image = resources.images.get(handle)
        views = [create_view(device, image, "d32f", layer=layer, layers=1) for layer in range(layers)]
        renderings, kept = (
            [Rendering((size, size), None, replace(image, view=view), None, clear) for view in views]
            for clear in (0.0, None)
        )
        change = partial(image_barrier, image.handle, image.aspect)
        return _Target(
            image,
            renderings,
            kept,
            barriers(change("sampled", "depth", discard=True)),
            barriers(change("depth", "sampled")),
        )

    # --- culling ---

    def make_lists(self, lists: ShadowLists) -> None:
        """Create the buffers of other lists; earlier ones are freed after the last frame that uses them."""
        resources = self._backend.resources
        self._free_lists()
        contents, sizes = lists.contents, lists.sizes
        for name in TABLES:
            size = lists.bytes_of(name)
            self._tables[name] = resources.buffer(size, _STORAGE, "device", f"shadow {name}")
        with Uploader(self._backend.device) as uploader:
            for name, table in contents.items():
                if table.nbytes:
                    uploader.buffer(resources.buffers.get(self._tables[name]), table)
            never = np.array([1 << 24], np.uint32)
            uploader.buffer(resources.buffers.get(self._tables["numbers"]), never, sizes["numbers"] - 4)

    def _table(self, name: str) -> Buffer:
        buffer: Buffer = self._backend.resources.buffers.get(self._tables[name])
        return buffer

    def begin_lists(self, commands: Commands) -> None:
        """Let kernels write lists and commands that earlier draws have read."""
        commands.barrier(_AFTER_DRAWS)

    def held_tables(self, slot: int) -> dict[int, Any]:
        """Return what kernels that cull bind in a slot (cull.glsl)."""
        held = {0: self.blocks[slot], **self._backend.data.held_instances(slot, 1, 8)}
        return held | {binding: self._table(name) for binding, name in enumerate(TABLES, 2)}

    def bind_lists(self, commands: Any, kernel: Built) -> None:
        """Bind a kernel that culls; both have one layout of bindings."""
        if self._list_sets is None:
            tables = []
            for slot in range(SLOTS):
                tables.append((kernel.sets[0], self.held_tables(slot), f"shadow lists, slot {slot}"))
            self._list_sets = self._backend.descriptors.create(tables)
            self._list_handles = [vk.array("VkDescriptorSet", [it]) for it in self._list_sets.handles]
        commands.bind_compute(kernel)
        commands.bind_compute_set(kernel, 0, self._list_handles[commands.slot.index])

    def _free_lists(self) -> None:
        resources = self._backend.resources
        if self._list_sets is not None:
            resources.defer(partial(self._backend.descriptors.destroy, self._list_sets))
        for handle in self._tables.values():
            resources.destroy_buffer(handle)
        self._tables, self._list_sets = {}, None

    # --- recording ---

    def begin_round(self, commands: Commands, size: int) -> None:
        """Make the target of a size ready to be drawn to, after the last copy out of it."""
        commands.barrier(self._targets[size].to_draw)

    def end_face(self, commands: Commands) -> None:
        """End drawing."""
        commands.end_rendering()

    def store(self, commands: Any, kernel: Built, size: int, number: int) -> None:
        """Copy layers into the pages."""
        target = self._targets[size]
        commands.barrier(target.to_read)
        commands.bind_compute(kernel)
        commands.bind_compute_set(kernel, 0, self._set(kernel, size, commands.slot.index))
        commands.push(kernel, np.array([[number, 0, 0, 0]], np.uint32))
        commands.dispatch_indirect(self.blocks[commands.slot.index], self.layout.rounds + 16 * number)

    def _set(self, kernel: Built, size: int, slot: int) -> Any:
        """Return the set of the kernel for a target, made for both slots at first use."""
        if (size, slot) not in self._sets:
            sampler = self._backend.resources.sampler(NEAREST, 1.0)
            drawn = Texture(self._targets[size].image.view, sampler)
            tables = [
                (
                    kernel.sets[0],
                    {0: block, 1: drawn, 2: self.held_pages},
                    f"shadow faces of {size}, slot {number}",
                )
                for number, block in enumerate(self.blocks)
            ]
            sets = self._backend.descriptors.create(tables)
            self._alive.append(sets)
            for number, handle in enumerate(sets.handles):
                self._sets[size, number] = vk.array("VkDescriptorSet", [handle])
        return self._sets[size, slot]

    def close(self) -> None:
        """Give everything up; frames in flight may still use it."""
        resources, descriptors = self._backend.resources, self._backend.descriptors
        self._free_lists()
        for sets in self._alive:
            resources.defer(partial(descriptors.destroy, sets))
        for handle in self._handles:
            resources.destroy_buffer(handle)
        for handle in self._images:
            resources.destroy_image(handle)
        self._alive, self._handles, self._images = [], [], []
