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
from ..frames.commands import MeshDraw
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import TABLES as SET
from ..frames.vulkan_commands import Commands
from ..graph.sync.vulkan import layout_of
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Held, Texture
from .kernels import COUNTERS, IN_SLOT, LISTS, OVERLAY, PYRAMIDS, TABLES, TRANSPARENT, Kernels, OverlayDraw

_STORED = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
_TO_THE_CPU = barriers(memory=(*_STORED, vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT))
_STORAGE = (
    vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
)


class CullingKernels(Kernels):
    """The buffers by name, and a descriptor set for each kind of kernel and slot."""

    def __init__(self, backend: VulkanBackend) -> None:
        super().__init__(backend)
        self._device = backend.device
        self._handles: dict[str, Handle] = {}
        self._sets: Any = None
        self._bound: dict[tuple[str, int], Any] = {}

    # --- memory ---

    def make_buffers(self, sizes: Mapping[str, int], contents: Mapping[str, np.ndarray]) -> None:
        """Create new buffers of these sizes in bytes; earlier ones are freed after the last frame that uses them."""
        self._free(but=COUNTERS)
        resources = self._backend.resources
        for name, size in sizes.items():
            if name not in IN_SLOT:
                self._handles[name] = resources.buffer(size, _STORAGE, "device", f"culling {name}")
                continue
            usage = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT if name == "view" else _STORAGE
            for slot in range(SLOTS):
                if (key := f"{name} {slot}") not in self._handles:
                    self._handles[key] = resources.buffer(size, usage, IN_SLOT[name], f"culling {key}")
        with Uploader(self._device) as uploader:
            for name, table in contents.items():
                if len(table):
                    uploader.buffer(resources.buffers.get(self._handles[name]), table.view(np.uint32))

    def _own(self, name: str) -> Buffer | None:
        return self._backend.resources.buffers.get(self._handles[name]) if name in self._handles else None

    def make_bindings(
        self, kernels: Mapping[str, Built], meshlets: Built | None, overlay: Built | None, depth: str
    ) -> None:
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
                *(
                    (name, kernels.get("pyramid"), 0, partial(self._depths, slot, depth, name))
                    for name in PYRAMIDS
                ),
                ("tables", meshlets, SET, partial(self._table, TABLES, slot)),
                ("overlay", overlay, SET, partial(self._table, OVERLAY, slot)),
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

    def _depths(self, slot: int, depth: str, pyramid: str) -> dict[int, Held]:
        image = self._backend.executor.images.image(slot, depth)
        assert isinstance(image, Image), depth
        sampler = self._backend.resources.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0)
        return {0: Texture(image.view, sampler, layout_of("read", image)), 1: self._buffer(pyramid)}

    # --- frames ---

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

    def mesh_draw(self, slot: int, constants: NDArray[np.uint32], word: int) -> MeshDraw:
        """Return the draw of mesh shaders whose arguments are at a word of `state`."""
        return MeshDraw(self._bound["tables", slot], constants, self._buffer("state"), 4 * word)

    def draw_overlay(self, commands: Commands, slot: int, draw: OverlayDraw) -> None:
        """Record a draw of the overlay, by whichever thread records draws."""
        tables = self._bound["overlay", slot]

        def record(commands: Commands) -> None:
            commands.bind_pipeline(draw.pipeline)
            commands.bind_set(draw.pipeline, SET, tables)
            commands.push(draw.pipeline, draw.constants)
            self._device.fn.vkCmdDraw(commands.handle, draw.vertices, draw.instances, 0, 0)
            commands.work["draws"] += 1
            commands.work["draw_calls"] += 1

        commands.draw_by(record)

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU."""
        commands.barrier(_TO_THE_CPU)

    def _free(self, but: str = "-") -> None:
        for name in [name for name in self._handles if not name.startswith(but)]:
            self._backend.resources.destroy_buffer(self._handles.pop(name))

    def close(self) -> None:
        """Give the buffers up; frames in flight may still use them."""
        self._free()
