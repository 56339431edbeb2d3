"""The study blue-noise on Vulkan: images, their transforms in two dispatches, and the picture."""

from __future__ import annotations

import numpy as np

from common.numerics.blue_noise import SIZE
from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import WRITTEN, Stage
from . import (
    IMAGE_BYTES,
    IMAGES,
    KERNELS,
    KINDS,
    LINE_BYTES,
    POWER_BYTES,
    SHADERS,
    STUDY,
    WAYS,
    Settings,
    defines,
    extent,
    push,
    tables,
    told,
    turns,
    work,
)


class Renderer(Stage):
    """A ramp by white and blue noise, beside the spectra of its errors."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Upload tables, make room for images and spectra, and build the pipelines."""
        self._images = self.empty(IMAGE_BYTES, ["storage"], "images")
        self._powers = self.empty(POWER_BYTES, ["storage"], "powers")
        lines = self.empty(LINE_BYTES, ["storage"], "lines")
        held = {0: self.filled(tables(), ["storage"], "tables"), 1: self._images}
        held |= {2: self.filled(turns(), ["storage"], "turns"), 3: lines, 4: self._powers}
        self._sample, self._transform, self._show = built = self.pipelines.get(
            [
                *(ComputeDescription(kernel, defines(), name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, defines(), color="rgba8", depth=None, name="show"),
            ]
        )
        bound = ((0, 1), (1, 2, 3, 4), (1, 4))
        self._sampling, self._transforming, self._drawing = (
            self.set_of(pipeline, {number: held[number] for number in numbers}, pipeline.described.name)
            for pipeline, numbers in zip(built, bound, strict=True)
        )

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Take samples, transform rows and columns of their errors, and show."""
        knobs = self.settings
        commands.barrier(self.shown)
        self.compute(commands, self._sample, self._sampling, push(knobs), (SIZE, SIZE, len(WAYS)))
        for columns in (False, True):
            pushed, lines = push(knobs, columns), extent(columns)
            self.compute(commands, self._transform, self._transforming, pushed, lines)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing)
        commands.push(self._show, np.array([*self.size, knobs.frames, knobs.steps], np.uint32))
        commands.draw_triangle()
        self.end(commands)
        self.work = work()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return what the spectra of the last frame say, after a wait for it."""
        return told(self.spectra())

    def images(self) -> np.ndarray:
        """Return the images of the last frame, (WAYS, IMAGES, SIZE, SIZE) float32."""
        shape = len(WAYS), len(IMAGES), SIZE, SIZE
        return self.download(self._images, WRITTEN).view(np.float32).reshape(shape)

    def spectra(self) -> np.ndarray:
        """Return the power of the errors of the last frame, (WAYS, KINDS, SIZE, SIZE) float32."""
        shape = len(WAYS), len(KINDS), SIZE, SIZE
        return self.download(self._powers, WRITTEN).view(np.float32).reshape(shape)
