"""The study vertex-pulling on Vulkan: one buffer, read by the GPU as attributes or by the shader as storage."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from backends.vulkan import api as vk
from common.scene import Scene
from common.scene.primitive import alone, primitive_of
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding
from ..drawing_vulkan import Drawing
from . import STUDY, UNIFORM_BYTES, Settings, drawn, uniforms, vertices_of

BINDINGS = (Binding(0, "uniform"), Binding(1, "storage"))


class Renderer(Drawing):
    """One object of a scene, turning, its vertices fetched in either way."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    has_depth = True

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def create(self) -> None:
        """Upload vertices and indices, and make the pipeline: with a vertex layout, or with an empty one."""
        primitive = primitive_of(self.scene)
        vertices = self.filled(vertices_of(primitive), ["vertex", "storage"], "vertices")
        indices = self.filled(primitive.indices, ["index"], "indices")
        self._count = len(primitive.indices)
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "matrices")
        self._sets = self.sets(BINDINGS, [{0: buffer, 1: vertices} for buffer in self._uniforms])
        self._pipeline = self.build(BINDINGS, drawn(self.settings))
        first = vk.array("VkBuffer", [vertices.handle]), vk.array("VkDeviceSize", [0])
        # Pulled: no vertex buffer is bound at all. Meshes of any layout could then be drawn by one pipeline.
        streams = [(0, *first)] if self.settings.feed == "attributes" else []
        self._bound = streams, indices.handle, 0

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw by index; the calls are the same for both ways."""
        slot, aspect = commands.slot.index, self.size[0] / self.size[1]
        self._uniforms[slot].view(np.float32)[:] = uniforms(self.scene, view, time, aspect).ravel()
        self.begin(commands)
        self.bind(commands, self._pipeline, self._sets[slot])
        commands.bind_geometry(*self._bound)
        self.device.fn.vkCmdDrawIndexed(commands.handle, self._count, 1, 0, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, self._count // 3
