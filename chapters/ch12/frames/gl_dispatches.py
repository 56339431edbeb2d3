"""Compute commands on OpenGL: the dispatches of `Commands`; compare vulkan_dispatches.py.

The graph sets the barriers between passes (graph/sync/gl.py). If a dispatch reads what an earlier dispatch of the same
pass wrote, the pass itself calls `compute_barrier` between them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context

from ..pipelines.description import Built
from .commands import SceneBinding
from .dispatches import DispatchCommands

_STORED = (
    gl.GL_SHADER_STORAGE_BARRIER_BIT
    | gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT
    | gl.GL_TEXTURE_FETCH_BARRIER_BIT
    | gl.GL_COMMAND_BARRIER_BIT
)


class Dispatches(DispatchCommands):
    """The compute methods of `Commands`."""

    _context: Context

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Bind the program of the next dispatches, and the sources; the scene is bound once a frame."""
        self._context.fn.glUseProgram(pipeline.handle)
        self.work["pipeline_binds"] += 1
        if self.sources is not None:
            self.sources.bind(self._context)
            self.work["descriptor_binds"] += 1

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants, to values that are fixed in a recording: sizes, counts, levels."""
        self._context.push(np.array(data))  # a copy: every frame makes the call again

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run x * y * z work groups of the bound program."""
        self._context.fn.glDispatchCompute(x, y, z)
        self.work["dispatches"] += 1

    def dispatch_indirect(self, buffer: Any, offset: int) -> None:
        """Run as many work groups as three words at a byte offset of a buffer say, after a `compute_barrier`."""
        fn = self._context.fn
        fn.glBindBuffer(gl.GL_DISPATCH_INDIRECT_BUFFER, buffer.handle)
        fn.glDispatchComputeIndirect(offset)
        self.work["dispatches"] += 1

    def compute_barrier(self) -> None:
        """Make later dispatches wait for earlier ones, and make the stores of those visible."""
        self._context.fn.glMemoryBarrier(_STORED)
