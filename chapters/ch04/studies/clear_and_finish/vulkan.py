"""The study clear-and-finish on Vulkan: an empty pass that clears, a pass that loads, a barrier into a layout."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import CLEAR_COLOR, CLEAR_DEPTH, PANELS, SHADERS, STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(Stage):
    """Three layers, one behind the other."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Make what the panels are drawn with, and note in which state the picture will be handed on."""
        self.leaves = self.settings.finish
        described = PipelineDescription(SHADERS, color="rgba8", depth="write", name="panels")
        self._pipeline = self.pipelines.get([described])[0]
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "place of the panels")
        layout = self._pipeline.sets[0]
        assert layout is not None  # the shaders declare it
        sets = self.descriptors.create(
            [(layout, {0: uniform}, f"set of {uniform.name}") for uniform in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]

    def create_sized(self) -> None:
        """Make what each layer records: barriers, and how a pass begins. All of it is the same in every frame."""
        picture, depth = self.picture, self.depth
        assert depth is not None

        # Nothing is kept ("discard"), but the copies of the frame before must be over.
        self._ready = barriers(
            image_barrier(picture.handle, picture.aspect, "copy_source", "color", discard=True),
            image_barrier(depth.handle, depth.aspect, "copy_source", "depth", discard=True),
        )
        self._clearing = Rendering(self.size, picture, depth, CLEAR_COLOR, CLEAR_DEPTH)

        # No layout changes. Still the next pass must wait until the clear is written: it loads what it finds.
        self._after = barriers(
            image_barrier(picture.handle, picture.aspect, "color", "color"),
            image_barrier(depth.handle, depth.aspect, "depth", "depth"),
        )
        self._loading = Rendering(self.size, picture, depth)

        self._finished = barriers(image_barrier(picture.handle, picture.aspect, "color", self.leaves))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record one layer after the other, each under its name."""
        self._uniforms[commands.slot.index].view(np.float32)[:] = uniforms(time)
        layers: list[tuple[str, Callable[[Commands], None]]] = [("clear", self.clear)]
        if self.settings.panels:
            layers.append(("panels", self.panels))
        layers.append(("finish", self.finish))
        for name, record in layers:
            commands.begin_label(name)
            record(commands)
            commands.end_label()

    def clear(self, commands: Commands) -> None:
        """Clear by beginning a pass: a GPU that draws tile by tile starts each with these values, at no cost."""
        commands.barrier(self._ready)
        commands.begin_rendering(self._clearing)
        commands.end_rendering()

    def panels(self, commands: Commands) -> None:
        """Draw on what is there."""
        commands.barrier(self._after)
        commands.begin_rendering(self._loading)
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[commands.slot.index])
        self.device.fn.vkCmdDraw(commands.handle, 6, PANELS, 0, 0)
        commands.end_rendering()
        self.work.draws, self.work.triangles = 1, 2 * PANELS

    def finish(self, commands: Commands) -> None:
        """Bring the picture into the layout in which it is handed on. A barrier does it: there is nothing to draw.

        Where passes are objects (study render-passes), this is one without draws whose final layout does the same.
        """
        commands.barrier(self._finished)
