"""Culling on Vulkan: buffers, descriptor sets, and dispatches whose size is on the GPU."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.resources import Buffer, Image
from backends.vulkan.upload import Uploader
from common.numerics.pools import Handle
from common.scene import Sampler

from ..frames.backend.vulkan import VulkanBackend
from ..frames.commands import Counted, MeshDraw
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..graph.sync.vulkan import layout_of
from ..meshlets.model import SceneMeshlets
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Held, Texture
from .kernels import CLEARED, IN_SLOT, LISTS, TABLES, TRANSPARENT, cleared, sizes_of, tables_of
from .lists import CullingLists

_TO_THE_CPU = barriers(
    memory=(
        vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
        vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
        vk.VK_PIPELINE_STAGE_2_HOST_BIT,
        vk.VK_ACCESS_2_HOST_READ_BIT,
    )
)
_STORAGE = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
)


class CullingKernels:
    """The buffers by name, and a descriptor set for each kind of kernel and slot."""

    def __init__(self, backend: VulkanBackend) -> None:
        self._backend, self._device = backend, backend.device
        self.counts_draws = backend.plan.native("draw-indirect-count")
        self._handles: dict[str, Handle] = {}
        self._sets: Any = None
        self._bound: dict[tuple[str, int], Any] = {}

    # --- memory ---

    def make_lists(
        self,
        lists: CullingLists,
        meshlets: SceneMeshlets | None,
        instances: int,
        copied: int,
        pyramid_words: int,
    ) -> None:
        """Create the buffers of new tables; the memory of earlier ones is freed after the last frame that uses it."""
        self._free()
        tables = tables_of(lists, meshlets)
        sizes = sizes_of(lists, tables, pyramid_words, instances, copied)
        resources = self._backend.resources
        for name, size in sizes.items():
            if name not in IN_SLOT:
                self._handles[name] = resources.buffer(size, _STORAGE, "device", f"culling {name}")
                continue
            usage = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT if name == "view" else _STORAGE
            for slot in range(SLOTS):
                handle = resources.buffer(size, usage, IN_SLOT[name], f"culling {name}, slot {slot}")
                self._handles[f"{name} {slot}"] = handle
        with Uploader(self._device) as uploader:
            for name, table in tables.items():
                if len(table):
                    uploader.buffer(self._buffer(name), table.view(np.uint32))
            for name in CLEARED:
                buffer = resources.buffers.get(self._handles[name])
                uploader.buffer(buffer, cleared(buffer.size))

    def _buffer(self, name: str, slot: int = 0) -> Buffer:
        if name == "instances":
            return self._backend.data.slots[slot].instances
        if name == "source":
            return self._backend.data.slots[slot].commands
        if name == "seen":
            return self._buffer("visible", 1 - slot)
        return self._backend.resources.buffers.get(
            self._handles[f"{name} {slot}" if name in IN_SLOT else name]
        )

    def make_bindings(self, kernels: Mapping[str, Built], meshlets: Built | None, depth: str) -> None:
        """Create the sets of the kernels, by kind, for the images that the graph has now."""
        backend = self._backend
        if self._sets is not None:
            backend.resources.defer(partial(backend.descriptors.destroy, self._sets))
        keys: list[tuple[str, int]] = []
        described = []
        for slot in range(SLOTS):
            tables = [
                ("lists", kernels.get("lists"), 0, partial(self._table, LISTS, slot)),
                ("transparent", kernels.get("transparent"), 0, partial(self._table, TRANSPARENT, slot)),
                ("pyramid", kernels.get("pyramid"), 0, partial(self._depths, slot, depth)),
                ("tables", meshlets, 3, partial(self._table, TABLES, slot)),
            ]
            for kind, pipeline, number, contents in tables:
                if pipeline is not None:
                    layout = pipeline.sets[number]
                    assert layout is not None, kind
                    keys.append((kind, slot))
                    described.append((layout, contents(), f"culling {kind}, slot {slot}"))
        self._sets = backend.descriptors.create(described)
        handles = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        self._bound = dict(zip(keys, handles, strict=True))

    def _table(self, names: tuple[str, ...], slot: int) -> dict[int, Held]:
        held: dict[int, Held] = {binding: self._buffer(name, slot) for binding, name in enumerate(names)}
        if "instances" in names:
            held |= self._backend.data.held_instances(slot, names.index("instances"), len(names))
        return held

    def _depths(self, slot: int, depth: str) -> dict[int, Held]:
        image = self._backend.executor.images.image(slot, depth)
        assert isinstance(image, Image), depth
        sampler = self._backend.resources.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0)
        return {0: Texture(image.view, sampler, layout_of("read", image)), 1: self._buffer("pyramid")}

    # --- frames ---

    def write_view(self, slot: int, constants: NDArray[np.uint8]) -> None:
        """Write the view of culling for a slot."""
        self._buffer("view", slot).mapped[: len(constants)] = constants

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        buffer = self._buffer("told", slot)
        assert buffer.allocation is not None, "the CPU reads it"
        self._device.memory.invalidate(buffer.allocation)
        counters: NDArray[np.uint32] = buffer.view(np.uint32).copy()
        return counters

    def bind(self, commands: Commands, kind: str, pipeline: Built, slot: int) -> None:
        """Bind a pipeline with the set of its kind."""
        commands.bind_compute(pipeline)
        commands.bind_compute_set(pipeline, 0, self._bound[kind, slot])

    def dispatch(self, commands: Commands, word: int) -> None:
        """Dispatch the groups whose numbers are in three words of `state`."""
        commands.dispatch_indirect(self._buffer("state"), 4 * word)

    def counted(self, word: int) -> Counted:
        """Return the draw commands with the word of `state` that holds their number."""
        return Counted(self._buffer("commands"), self._buffer("state"), 4 * word, self.counts_draws)

    def mesh_draw(self, slot: int, constants: NDArray[np.uint32], word: int) -> MeshDraw:
        """Return the draw of mesh shaders whose arguments are at a word of `state`."""
        return MeshDraw(self._bound["tables", slot], constants, self._buffer("state"), 4 * word)

    def target(self, slot: int) -> Buffer:
        """Return the draw commands of blended objects."""
        return self._buffer("target", slot)

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU."""
        commands.barrier(_TO_THE_CPU)

    def _free(self) -> None:
        for handle in self._handles.values():
            self._backend.resources.destroy_buffer(handle)
        self._handles = {}

    def close(self) -> None:
        """Give the buffers up; frames in flight may still use them."""
        self._free()
