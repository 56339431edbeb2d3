"""The frame of the studies names, barriers and memory on Vulkan; a study adds images and what happens before a pass."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Image
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import EMPTY, FORMAT, TEXELS, Pass, passes, shaders, size_of


class GlowStage(Stage):
    """Draws the passes of `passes_in_order()` to `images()`, with the barriers of `dependency(name)` before each."""

    moves = False
    passes_by_name: Mapping[str, Pass]

    def described(self) -> Mapping[str, Pass]:
        """Return the declared passes by name."""
        return passes()

    @abstractmethod
    def passes_in_order(self) -> Sequence[str]:
        """Return the names of the passes in the order in which the frame runs them."""

    @abstractmethod
    def images(self) -> Mapping[str, Image]:
        """Return an image for each name that a pass writes."""

    @abstractmethod
    def dependency(self, name: str) -> Any:
        """Return the VkDependencyInfo before a pass, or None."""

    def create(self) -> None:
        """Make a pipeline for each pass."""
        self.passes_by_name = self.described()
        wanted = [
            PipelineDescription(
                shaders(described),
                described.defines,
                color=FORMAT if described.writes else "rgba8",
                depth=None,
                name=name,
            )
            for name, described in self.passes_by_name.items()
        ]
        self._pipelines = dict(zip(self.passes_by_name, self.pipelines.get(wanted), strict=True))
        self._sampler = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Plan the frame, and make what its passes draw to, read and wait for."""
        self._order = self.passes_in_order()
        self._images = self.images()
        self._before = {name: self.dependency(name) for name in self._order}
        self._sets = {name: self._set(name) for name in self._order if self.passes_by_name[name].reads}
        self._renderings = {
            name: Rendering(size_of(self.passes_by_name[name], self.size), self._images[written], None, EMPTY)
            for name in self._order
            if (written := self.passes_by_name[name].writes)
        }

    def _set(self, name: str) -> Any:
        layout = self._pipelines[name].sets[0]
        assert layout is not None, "a pass that reads has a set"
        held = {
            number: Texture(self._images[source].view, self._sampler)
            for number, source in enumerate(self.passes_by_name[name].reads)
        }
        sets = self.descriptors.create([(layout, held, f"set of {name}")])
        self.keep_sized(sets, self.descriptors.destroy)
        return vk.array("VkDescriptorSet", sets.handles)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the frame; the pass without a target draws to the picture of the stage."""
        for name in self._order:
            if self._before[name] is not None:
                commands.barrier(self._before[name])
            commands.begin_label(name)
            if name in self._renderings:
                commands.begin_rendering(self._renderings[name])
            else:
                self.begin(commands)
            commands.bind_pipeline(self._pipelines[name])
            if name in self._sets:
                commands.bind_set(self._pipelines[name], 0, self._sets[name])
            commands.draw_triangle()
            self.end(commands)
            commands.end_label()
            self.work.draws += 1
            self.work.triangles += 1
