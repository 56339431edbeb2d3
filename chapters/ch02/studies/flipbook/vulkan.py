"""The study flipbook on Vulkan: an array texture of a hundred pictures, a list of instances, one draw."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import (
    CAPACITY,
    RECORD,
    SHADERS,
    SMOOTH,
    STUDY,
    UNIFORM_BYTES,
    Settings,
    explosions,
    pictures,
    records_of,
)


class Renderer(Stage):
    """Explosions that began at different times, in different places."""

    study = STUDY
    settings_class: type = Settings
    explosions = staticmethod(explosions)  # yours may stand here
    pictures = staticmethod(pictures)

    def create(self) -> None:
        """Upload the book, and make what draws it."""
        book = Texture(self.texture(self.pictures(), "array", "book").view, self.sampler(SMOOTH, "book"))
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "picture's size")
        self._records = self.per_slot(CAPACITY * RECORD.itemsize, "storage", "explosions")
        described = PipelineDescription(SHADERS, color="rgba8", depth=None, blend="over", name=STUDY.title)
        self._pipeline = self.pipelines.get([described])[0]
        layout = self._pipeline.sets[0]
        assert layout is not None  # the shaders declare it
        slots = zip(self._uniforms, self._records, strict=True)
        sets = self.descriptors.create(
            [(layout, {0: u, 1: r, 2: book}, f"set with {r.name}") for u, r in slots]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Write this frame's instances and draw all at once; when all have gone out there is no draw."""
        slot = commands.slot.index
        records = records_of(self.explosions(self.settings, self.size, time), self.settings, self.size, time)
        self.begin(commands)
        if len(records):
            self._uniforms[slot].view(np.float32)[:2] = self.size
            self._records[slot].view(RECORD)[: len(records)] = records
            commands.bind_pipeline(self._pipeline)
            commands.bind_set(self._pipeline, 0, self._sets[slot])
            self.device.fn.vkCmdDraw(commands.handle, 6, len(records), 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = int(len(records) > 0), 2 * len(records)
