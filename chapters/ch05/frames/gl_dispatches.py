"""Calls of compute work: what `Commands` knows beside draws; compare vulkan_dispatches.py.

Barriers between passes are the graph's (graph/sync/gl.py). One between two dispatches of the same pass, where the
second reads what the first wrote, is the pass's own: `compute_barrier`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context

from ..pipelines.description import Built
from .commands import SceneBinding
from .dispatches import group_count

_STORED = (
    gl.GL_SHADER_STORAGE_BARRIER_BIT | gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT | gl.GL_TEXTURE_FETCH_BARRIER_BIT
)


class Dispatches:
    """The compute half of `Commands`."""

    _context: Context
    sources: Any
    work: dict[str, int]

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Use the program that the next dispatches run, and bind the sources; the scene is bound per frame."""
        self._context.fn.glUseProgram(pipeline.handle)
        self.work["pipeline_binds"] += 1
        if self.sources is not None:
            self.sources.bind(self._context)
            self.work["descriptor_binds"] += 1

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants to what a recording fixes: sizes, numbers, levels."""
        self._context.push(np.array(data))  # of its own: the call is made in every frame

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run work groups of the program that is in use."""
        self._context.fn.glDispatchCompute(x, y, z)
        self.work["dispatches"] += 1

    def dispatch_over(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run as many groups as cover `extent`, 1 to 3 numbers of invocations: pixels, or elements of an array."""
        self.dispatch(*group_count(extent, pipeline.group))

    def compute_barrier(self) -> None:
        """Let the dispatches behind this wait for those before it, and see what they stored."""
        self._context.fn.glMemoryBarrier(_STORED)
