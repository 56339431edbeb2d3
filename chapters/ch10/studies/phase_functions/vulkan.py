"""The study phase-functions on Vulkan: a kernel, and the picture."""

from __future__ import annotations

import numpy as np

from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import WRITTEN, Stage
from . import (
    KERNEL,
    LOBES,
    SHADERS,
    STUDY,
    VALUE_BYTES,
    Settings,
    defines,
    given,
    push,
    told,
    truth,
    work,
)
from .exact import POINTS


class Renderer(Stage):
    """Eight phase functions, and what two forms of them are off."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload directions and truth, make room for values, and build the pipelines."""
        self._values = self.empty(VALUE_BYTES, ["storage"], "values")
        asked, right = (
            self.filled(given(), ["storage"], "given"),
            self.filled(truth(self.settings), ["storage"], "truth"),
        )
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, defines(), name="phases"),
                PipelineDescription(SHADERS, defines(), color="rgba8", depth=None, name="show"),
            ]
        )
        self._evaluating = self.set_of(self._kernel, {0: asked, 1: self._values}, "phases")
        self._drawing = self.set_of(self._show, {1: self._values, 2: right}, "show")

    def create_sized(self) -> None:
        """Keep what is pushed: no frame changes it."""
        self._pushed = push(self.settings, self.size)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Evaluate, and show."""
        commands.barrier(self.shown)
        self.compute(commands, self._kernel, self._evaluating, self._pushed, (POINTS, LOBES))
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, self._pushed)
        commands.draw_triangle()
        self.end(commands)
        self.work = work()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the table of the last frame as counters, after a wait for it."""
        return told(self.settings, self.values())

    def values(self) -> np.ndarray:
        """Return the values of the last frame, (LOBES, POINTS, 4) float32."""
        return self.download(self._values, WRITTEN).view(np.float32).reshape(-1, POINTS, 4)
