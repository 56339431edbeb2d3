"""The level of textures at a scale that changes from frame to frame, written for shaders into the frame's constants.

A history gathers detail of the picture, so textures are looked up at the level that the picture's pixels ask for: a
frame at scale s adds log2 s to the level. The chapter compiles that sum into its shaders. Here shaders read it in each
frame, from the fourth component of `frame.ambient`, which the chapter does not use.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import FrameInfo, Pass, Technique
from common import layouts

from ...frames.backend.backend import Backend
from ...pipelines.description import Built, Described
from ...scene.pass_parts import PassParts
from ...shading.objects import ObjectsPass
from ...shadows.passes import ShadowsPass

BYTES = 4
PLACE = layouts.dtype("FrameConstants").fields["ambient"][1] + 3 * BYTES  # type: ignore[index]
"""The offset of the level in the frame's constants."""


class LevelledPipelines:
    """Pipelines of the renderer whose shaders add `level` to the level of textures: a number, or text in GLSL."""

    def __init__(self, pipelines: Any, level: float | str) -> None:
        self._pipelines, self._defines = pipelines, (("MIP_BIAS", level),) * (level != 0.0)

    def get(self, descriptions: Sequence[Described]) -> list[Built]:
        """Return one pipeline per description."""
        built: list[Built] = self._pipelines.get(
            [replace(it, defines=(*it.defines, *self._defines)) for it in descriptions]
        )
        return built


class LevelTechnique(Technique):
    """Writes the level of each frame, and lets the passes that draw objects read it."""

    name = "level"
    level = 0.0
    """What is added to the level of textures in the next frame."""

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Give the passes pipelines of their own; shadow maps have the level of the whole picture."""
        self._data = parts.data
        for gpu_pass in passes.values():
            if isinstance(gpu_pass, ObjectsPass):
                fixed = isinstance(gpu_pass, ShadowsPass)
                level: float | str = self.level if fixed else "frame.ambient.w"
                gpu_pass._pipelines = LevelledPipelines(parts.pipelines, level)  # type: ignore[assignment]

    def prepare(self, frame: FrameInfo) -> int:
        """Write the level; return the bytes written."""
        constants = self._data.slots[frame.slot].frame.view(np.uint8)
        constants[PLACE : PLACE + BYTES] = np.frombuffer(np.float32(self.level).tobytes(), np.uint8)
        return BYTES


def level_at(bias: float, scale: float) -> float:
    """Return what is added to the level of textures that are drawn at a scale."""
    return bias + math.log2(scale)
