"""The study wireframe on Vulkan: how triangles are filled and how far they are moved is part of a pipeline."""

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
from . import STUDY, UNIFORM_BYTES, Settings, corners_of, draws_of, plan_of, uniforms

BINDINGS = (Binding(0, "uniform"),)


class Renderer(Drawing):
    """One object of a scene, turning, with the edges of its triangles."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    has_depth = True

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def create(self) -> None:
        """Upload all corners, and make one pipeline for each draw."""
        # `fillModeNonSolid` is a feature that a device may lack, and phones often do. Then, or with --without
        # wireframe, edges come from the fragment shader.
        self.plan = plan_of(self.plan, self.capabilities, self.without, self.settings)
        self._corners = corners_of(primitive_of(self.scene))
        self._vertices = self.filled(self._corners, ["vertex"], "corners")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "uniforms")
        self._sets = self.sets(BINDINGS, [{0: buffer} for buffer in self._uniforms])
        draws = draws_of(self.plan.native("wireframe"), self.settings)
        self._pipelines = [self.build(BINDINGS, described) for described in draws]
        self._bound = vk.array("VkBuffer", [self._vertices.handle]), vk.array("VkDeviceSize", [0])

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the same triangles once for each pipeline: filled, and then their outlines."""
        fn, slot = self.device.fn, commands.slot.index
        aspect = self.size[0] / self.size[1]
        self._uniforms[slot].view(np.float32)[:] = uniforms(self.scene, self.settings, view, time, aspect)
        self.begin(commands)
        fn.vkCmdBindVertexBuffers(commands.handle, 0, 1, *self._bound)
        for pipeline in self._pipelines:
            self.bind(commands, pipeline, self._sets[slot])
            fn.vkCmdDraw(commands.handle, len(self._corners), 1, 0, 0)
        self.end(commands)
        self.work.draws = len(self._pipelines)
        self.work.triangles = len(self._pipelines) * len(self._corners) // 3
