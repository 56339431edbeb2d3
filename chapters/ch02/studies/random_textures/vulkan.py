"""The study random-textures on Vulkan: one set with flat textures and volumes, indexed by what differs everywhere."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...frames.vulkan_resources import Resources
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ...scene.textures.vulkan_bindless import DUMMY, Bindless
from ..stage_vulkan import Stage
from . import (
    SHADERS,
    SHARP,
    STUDY,
    TEXTURES,
    UNIFORM_BYTES,
    VOLUMES,
    Settings,
    defines,
    grid,
    textures,
    volumes,
)


class Renderer(Stage):
    """A grid of triangles, drawn at once, with 32 textures."""

    study = STUDY
    settings_class: type = Settings
    moves = False
    textures = staticmethod(textures)  # yours may stand here
    volumes = staticmethod(volumes)

    def create(self) -> None:
        """Upload the textures, give each a slot of the chapter's one set, and make the pipeline."""
        described = PipelineDescription(
            SHADERS, (*defines(self.settings), ("BINDLESS", 1)), color="rgba8", depth=None, name=STUDY.title
        )
        self._pipeline = self.pipelines.get([described])[0]
        uniforms, _, slots = self._pipeline.sets
        assert uniforms is not None and slots is not None  # the shaders declare them
        sharp = self.sampler(SHARP, "texels")
        resources = self.keep(Resources(self.device), Resources.close)
        dummy = Texture(self.texture(DUMMY, "2d", "dummy").view, sharp)
        held = Bindless(self.device, resources, 1 + TEXTURES + VOLUMES, dummy)
        self._bindless = self.keep(held, Bindless.close)
        # Slots are given out in order: texture n has slot n + 1, behind the dummy's.
        for number, pixels in enumerate(self.textures()):
            self._bindless.add(self.texture(pixels, "2d", f"texture {number}").view)
        for number, pixels in enumerate(self.volumes()):
            self._bindless.add(self.texture(pixels, "3d", f"volume {number}").view)
        self._bindless.create(slots)
        self._bindless.update()
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "picture's size")
        sets = self.descriptors.create(
            [(uniforms, {0: uniform}, f"set of {uniform.name}") for uniform in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the grid by one call."""
        slot, cells = commands.slot.index, grid(self.size)
        self._uniforms[slot].view(np.float32)[:3] = *self.size, cells[0]
        self.begin(commands)
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[slot])
        commands.bind_set(self._pipeline, 2, self._bindless.sets)
        self.device.fn.vkCmdDraw(commands.handle, 6 * cells[0] * cells[1], 1, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, 2 * cells[0] * cells[1]
