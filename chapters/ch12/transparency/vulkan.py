"""The memory of layers on Vulkan: buffers, and a descriptor set for each kind of pipeline and slot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.driver.features import CORE
from backends.vulkan.resources import Buffer, Image
from common.numerics.pools import Handle

from ..frames.backend.vulkan import VulkanBackend
from ..frames.commands import DrawGroup, SceneBinding
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import TABLES, Commands
from ..graph.sync.vulkan import layout_of
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Held, Texture
from .kernels import DRAWING, IN_SLOT, KINDS, Bound, Kernels

_STORED = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
_TO_THE_CPU = barriers(memory=(*_STORED, vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT))


class LayerKernels(Kernels):
    """The buffers by name, and the sets by kind and slot."""

    def __init__(self, backend: VulkanBackend) -> None:
        super().__init__(backend)
        self._handles: dict[str, Handle] = {}
        self._sets: Any = None
        self._bound: dict[tuple[str, int], Any] = {}

    def why_not(self) -> str:
        """Return what the device lacks for lists, or ""."""
        bits = self._backend.device.physical.bits
        if (CORE, "fragmentStoresAndAtomics") not in bits:
            return "lets fragments store nothing"
        return "" if (CORE, "geometryShader") in bits else "gives fragments no number of their triangle"

    # --- memory ---

    def make_buffers(self, sizes: Mapping[str, int]) -> None:
        """Create buffers of these sizes in bytes; earlier ones are freed after the last frame that uses them."""
        resources, usage = self._backend.resources, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        self._free([name for name in self._handles if name in sizes])
        for name, size in sizes.items():
            in_slots = [f"{name} {slot}" for slot in range(SLOTS)] if name in IN_SLOT else [name]
            for key in in_slots:
                if key not in self._handles:
                    use = IN_SLOT.get(name, "device")
                    self._handles[key] = resources.buffer(size, usage, use, f"layers {key}")

    def _buffer(self, name: str, slot: int) -> Buffer:
        key = f"{name} {slot}" if name in IN_SLOT else name
        buffer: Buffer = self._backend.resources.buffers.get(self._handles[key])
        return buffer

    def make_bindings(self, bound: Bound) -> None:
        """Create the sets of all pipelines, for the buffers and the images that there are now."""
        backend = self._backend
        self._forget_sets()
        kinds = [kind for kind in bound.pipelines if bound.lists or kind == "resolve"]
        keys = [(kind, slot) for kind in kinds for slot in range(SLOTS)]
        tables = []
        for kind, slot in keys:
            held: dict[int, Held] = {}
            if bound.lists:
                held |= {place: self._buffer(name, slot) for place, name in enumerate(KINDS[kind])}
            if kind == "resolve":
                for place, name in enumerate(bound.images, len(KINDS[kind])):
                    image = backend.executor.images.image(slot, name)
                    assert isinstance(image, Image), name
                    held[place] = Texture(image.view, vk.NULL, layout_of("general", image))
            layout = bound.pipelines[kind].sets[TABLES if kind in DRAWING else 0]
            tables.append((layout, held, f"layers {kind}, slot {slot}"))
        self._sets = backend.descriptors.create(tables)
        handles = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        self._bound = dict(zip(keys, handles, strict=True))

    # --- frames ---

    def bind(self, commands: Commands, kind: str, pipeline: Built) -> None:
        """Bind a compute pipeline with the set of its kind."""
        commands.bind_compute(pipeline)
        commands.bind_compute_set(pipeline, 0, self._bound[kind, commands.slot.index])

    def draw(self, commands: Commands, kind: str, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene that also bind the set of a kind.

        One thread records all of them. Atomics give each fragment a place of its own, which synchronization validation
        does not know: it takes the stores of two secondary command buffers for a hazard.
        """
        layered = scene._replace(layers=self._bound.get((kind, commands.slot.index)))
        commands.draw_by(lambda commands: commands.draw_groups(groups, layered))

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU."""
        commands.barrier(_TO_THE_CPU)

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        buffer = self._buffer("told", slot)
        assert buffer.allocation is not None, "the CPU reads it"
        self._backend.device.memory.invalidate(buffer.allocation)
        counters: NDArray[np.uint32] = buffer.view(np.uint32).copy()
        return counters

    # --- life ---

    def _forget_sets(self) -> None:
        if self._sets is not None:
            self._backend.resources.defer(partial(self._backend.descriptors.destroy, self._sets))
        self._sets, self._bound = None, {}

    def _free(self, names: list[str]) -> None:
        for name in names:
            self._backend.resources.destroy_buffer(self._handles.pop(name))

    def close(self) -> None:
        """Give buffers and sets up; frames in flight may still use them."""
        self._forget_sets()
        self._free([*self._handles])
