"""What task and mesh shaders read and draw to: the rows of a round, the words of meshlets, and layered rendering."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader

from ..frames.backend.vulkan import VulkanBackend
from ..frames.commands import MeshDraw
from ..frames.vulkan_commands import TABLES as SET
from ..frames.vulkan_commands import Commands, Rendering
from ..pipelines.description import Built
from ..shadows.vulkan import ShadowMemory

READ = ("draws", "meshlets", "words", "lists", "numbers", "rows")
"""The buffers of tables.glsl, in the order of their bindings."""

OWN = ("words", "rows")
"""Those of them that are only for layers."""

_STORED = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
_USAGE = _STORED | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT
_COMPUTE = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT
_TASKS = vk.VK_PIPELINE_STAGE_2_TASK_SHADER_BIT_EXT | vk.VK_PIPELINE_STAGE_2_MESH_SHADER_BIT_EXT
_READERS = _TASKS | vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT
_AFTER_TASKS = barriers(memory=(_READERS, 0, _COMPUTE, 0))
_BEFORE_TASKS = barriers(
    memory=(
        _COMPUTE,
        vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
        _READERS,
        vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT,
    )
)
_DEPTH = vk.VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | vk.VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT
_DRAWN_OVER = barriers(
    memory=(
        _DEPTH,
        vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
        _DEPTH,
        vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT | vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
    )
)


class LayerMemory:
    """Buffers of the renderer's resources, which free them."""

    def __init__(self, backend: VulkanBackend) -> None:
        self._backend = backend
        self.most_layers = most_layers(backend.device)
        self._memory: ShadowMemory
        self._words: NDArray[np.uint32] | None = None
        self._handles: dict[str, Any] = {}
        self._sets: dict[str, Any] = {}
        self._renderings: dict[tuple[int, int], Rendering] = {}

    def make(self, memory: ShadowMemory, words: NDArray[np.uint32], row_bytes: int) -> None:
        """Create the buffers beside other lists; earlier ones are freed after the last frame that uses them."""
        resources, self._memory = self._backend.resources, memory
        for sets in self._sets.values():
            resources.defer(partial(self._backend.descriptors.destroy, sets))
        for name in OWN if words is not self._words else OWN[1:]:
            if name in self._handles:
                resources.destroy_buffer(self._handles.pop(name))
        self._sets.clear()
        self._handles["rows"] = resources.buffer(row_bytes, _USAGE, "device", "shadow rows")
        if words is not self._words:
            self._words = words
            self._handles["words"] = resources.buffer(max(16, words.nbytes), _USAGE, "device", "shadow words")
            if len(words):
                with Uploader(self._backend.device) as uploader:
                    uploader.buffer(self._buffer("words"), words)

    def _buffer(self, name: str) -> Buffer:
        if name not in OWN:
            return self._memory._table(name)
        buffer: Buffer = self._backend.resources.buffers.get(self._handles[name])
        return buffer

    def _bound(self, kind: str, layout: Any, contents: list[dict[int, Any]]) -> Any:
        """Return the sets of a kind, made at first use."""
        if kind not in self._sets:
            tables = [(layout, held, f"shadow {kind}") for held in contents]
            self._sets[kind] = self._backend.descriptors.create(tables)
        return self._sets[kind].handles

    # --- recording ---

    def wait(self, commands: Commands) -> None:
        """Let kernels write what task and mesh shaders have read."""
        commands.barrier(_AFTER_TASKS)

    def wait_for_rows(self, commands: Commands) -> None:
        """Let task and mesh shaders read what kernels have written."""
        commands.barrier(_BEFORE_TASKS)

    def bind(self, commands: Commands, kernel: Built) -> None:
        """Bind layers.comp."""
        contents = [
            {0: block, 1: self._buffer("numbers"), 2: self._buffer("rows")} for block in self._memory.blocks
        ]
        handles = self._bound("rows", kernel.sets[0], contents)
        commands.bind_compute(kernel)
        bound = vk.array("VkDescriptorSet", [handles[commands.slot.index]])
        commands.bind_compute_set(kernel, 0, bound)

    def mesh_draw(self, pipeline: Built, constants: NDArray[np.uint32], offset: int) -> MeshDraw:
        """Return the draw of a batch whose arguments are at a byte of the rows."""
        held = {binding: self._buffer(name) for binding, name in enumerate(READ)}
        handles = self._bound("meshlets in layers", pipeline.sets[SET], [held])
        return MeshDraw(vk.array("VkDescriptorSet", [handles[0]]), constants, self._buffer("rows"), offset)

    def begin_layers(self, commands: Commands, size: int, count: int) -> None:
        """Begin drawing to the first layers of the target of a size, after clearing them to the far plane."""
        if (size, count) not in self._renderings:
            image = self._memory._targets[size].image
            rendering = Rendering((image.width, image.height), None, image, None, 0.0)
            rendering.info.layerCount = count
            self._renderings[size, count] = rendering
        commands.begin_rendering(self._renderings[size, count])

    def end_layers(self, commands: Commands) -> None:
        """End it; what is drawn next to one of the layers is drawn over it."""
        commands.end_rendering()
        commands.barrier(_DRAWN_OVER)


def most_layers(device: Device) -> int:
    """Return how many layers mesh shaders may draw to at once."""
    meshes = vk.new("VkPhysicalDeviceMeshShaderPropertiesEXT")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=meshes)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    return int(min(meshes.maxMeshOutputLayers, device.limits.maxFramebufferLayers))
