"""The study buffer-address on Vulkan: indices and vertices in one buffer, the latter found by adding to its address."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import buffer_address
from common.scene import Scene
from common.scene.primitive import alone, primitive_of
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import SHADERS, STUDY, UNIFORM, Settings, uniforms, vertices_of


class Renderer(Stage):
    """One object of a scene, turning, its vertices reached in either way."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def create(self) -> None:
        """Upload the object and find out where it lies, or put its vertices into a set."""
        primitive, by_address = primitive_of(self.scene), self.settings.feed == "address"
        vertices, indices = vertices_of(primitive), primitive.indices
        self._uniforms = self.per_slot(UNIFORM.itemsize, "uniform", "matrices and address")
        held: dict[int, Any] = {}
        if by_address:
            # Vertices right behind the indices. As an offset of a descriptor that would have to be a multiple of
            # minStorageBufferOffsetAlignment, up to 256; an address need only be one of 4, as the shader promises.
            both = np.concatenate([indices.ravel().view(np.uint8), vertices.ravel().view(np.uint8)])
            self._indices = self.filled(both, ["index", "address"], "indices and vertices")
            self._address = buffer_address(self.device, self._indices) + indices.nbytes
        else:
            self._indices = self.filled(indices, ["index"], "indices")
            held = {1: self.filled(vertices, ["storage"], "vertices")}
            self._address = 0
        self._count = len(indices)
        described = PipelineDescription(
            SHADERS, (("BY_ADDRESS", int(by_address)),), color="rgba8", depth="write", name=STUDY.title
        )
        self._pipeline = self.pipelines.get([described])[0]
        layout = self._pipeline.sets[0]
        assert layout is not None  # the shaders declare it
        sets = self.descriptors.create(
            [(layout, {0: uniform, **held}, f"set of {uniform.name}") for uniform in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw by index; the calls are the same for both ways."""
        slot, aspect = commands.slot.index, self.size[0] / self.size[1]
        self._uniforms[slot].view(UNIFORM)[0] = uniforms(self.scene, view, time, aspect, self._address)
        self.begin(commands)
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[slot])
        fn = self.device.fn
        fn.vkCmdBindIndexBuffer(commands.handle, self._indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        fn.vkCmdDrawIndexed(commands.handle, self._count, 1, 0, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, self._count // 3
