"""The study far-march on Vulkan: the grid, the fog of pixels, and the picture."""

from __future__ import annotations

import numpy as np

from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import WRITTEN, Stage
from . import BLOCK_BYTES, KERNELS, SHADERS, STUDY, Settings, block, froxel_bytes, work


class Renderer(Stage):
    """A plain in fog that goes on behind its grid."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Make the grid and build the pipelines."""
        self._blocks = self.per_slot(BLOCK_BYTES, "uniform", "air")
        self._grid = self.empty(froxel_bytes(self.settings), ["storage"], "grid")
        self._fill, self._march, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, color="rgba8", depth=None, name="show"),
            ]
        )
        self._filling = [self.set_of(self._fill, {0: air, 1: self._grid}, "grid") for air in self._blocks]

    def create_sized(self) -> None:
        """Make room for the fog of each pixel, and what refers to it."""
        self._fog = fog = self.empty(16 * self.size[0] * self.size[1], ["storage"], "fog", sized=True)
        self._marching, self._drawing = (
            [self.set_of(pipeline, {0: air, **held}, "fog", sized=True) for air in self._blocks]
            for pipeline, held in ((self._march, {1: self._grid, 2: fog}), (self._show, {2: fog}))
        )

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Fill the grid, look up and march, and show."""
        slot, knobs = commands.slot.index, self.settings
        self._blocks[slot].view(np.float32)[:] = block(knobs, view, self.size)
        commands.barrier(self.shown)
        self.compute(commands, self._fill, self._filling[slot], None, (knobs.columns, knobs.rows))
        self.compute(commands, self._march, self._marching[slot], None, self.size)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing[slot])
        commands.draw_triangle()
        self.end(commands)
        self.work = work(knobs, self.size)

    def fog(self) -> np.ndarray:
        """Return light and transmittance between the eye and each pixel of the last frame, (H, W, 4) float32."""
        return self.download(self._fog, WRITTEN).view(np.float32).reshape(*self.size[::-1], 4)
