"""The study rotating-cube on Vulkan: a uniform buffer per frame in flight, the descriptor that shows it, and depth."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding, PipelineDescription
from ..stage_vulkan import Stage
from . import STUDY, matrices

UNIFORM_BYTES = 2 * 64

BINDINGS = (Binding(0, "uniform"),)
"""What the shaders read from outside, by number: `binding = 0` in cube.vert."""


class Renderer(Stage):
    """A cube whose corners are in the shader; only its place comes from here."""

    study = STUDY
    has_depth = True

    def create(self) -> None:
        """Make the buffers, one descriptor set for each, and the pipeline."""
        # While the CPU writes the numbers of the next frame, the GPU still reads those of this one. So there are as
        # many buffers as frames in flight, and each is written only once its frame is over.
        self._uniforms: list[Buffer] = []
        for slot in range(SLOTS):
            usage, name = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, f"matrices, slot {slot}"
            self._uniforms.append(create_buffer(self.device, UNIFORM_BYTES, usage, "upload", name))
        # A set is a table of references, filled once: the buffer stays the same, only its content changes.
        sets = self.descriptors.create(
            [(BINDINGS, {0: buffer}, f"set of {buffer.name}") for buffer in self._uniforms]
        )
        self._sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets.handles]
        # The study first-triangle writes a pipeline out in full; from here on a description is enough. `depth="write"`
        # draws a pixel only where it is not behind what was drawn there before, and notes how near it is.
        described = PipelineDescription(
            shaders=("studies/rotating_cube/cube.vert", "studies/rotating_cube/cube.frag"),
            sets=(BINDINGS,),
            color="rgba8",
            depth="write",
            name="cube",
        )
        self._pipeline = self.pipelines.get([described])[0]

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Write this frame's matrices and record the draw."""
        slot = commands.slot.index
        # Mapped memory: an assignment in numpy is the upload. It happens now, on the CPU; the draw happens later.
        self._uniforms[slot].view(np.float32)[:] = matrices(view, time, self.size[0] / self.size[1]).ravel()
        self.begin(commands)
        # Back faces could be left out ("culled"), which would halve the work. Here depth alone sorts them out.
        commands.bind_pipeline(self._pipeline)
        commands.bind_set(self._pipeline, 0, self._sets[slot])
        self.device.fn.vkCmdDraw(commands.handle, 36, 1, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, 12

    def destroy(self) -> None:
        """Free the buffers; sets and pipeline belong to the stage."""
        for buffer in getattr(self, "_uniforms", ()):
            destroy_buffer(self.device, buffer)
