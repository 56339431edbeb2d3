"""The stage of this chapter's studies on OpenGL: what all studies share, with this chapter's frames and pipelines.

These studies compute, too: the stage makes buffers for shaders to fill, and copies them to the CPU.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backends.gl import api as gl
from backends.gl.resources import Buffer, create_buffer, destroy_buffer, read_buffer
from backends.gl.stage import Graphics
from backends.gl.stage import Stage as AnyStage

from ..frames import frame
from ..frames.dispatches import group_count
from ..frames.gl import Frames
from ..pipelines.description import Built
from ..pipelines.gl import Pipelines


class Stage(AnyStage):
    """A study of this chapter on OpenGL."""

    frame_logic = frame
    graphics = Graphics(Frames, Pipelines)
    pipelines: Pipelines

    def dispatch_over(
        self, kernel: Built, extent: Sequence[int], push: np.ndarray | None = None
    ) -> tuple[int, int, int]:
        """Dispatch as many work groups of a kernel as cover `extent`, and return how many; the caller adds barriers."""
        groups = group_count(extent, kernel.group)
        self.device.fn.glUseProgram(kernel.handle)
        if push is not None:
            self.device.push(push)
        self.device.fn.glDispatchCompute(*groups)
        return groups

    def empty(self, size: int, name: str, sized: bool = False) -> Buffer:
        """Return a buffer in the GPU's own memory for shaders to fill; `download` copies it.

        A `sized` buffer is freed when the picture's size changes.
        """
        buffer = create_buffer(self.device, size, "device", name)
        return (self.keep_sized if sized else self.keep)(
            buffer, lambda resource: destroy_buffer(self.device, resource)
        )

    def shared(self, size: int, name: str) -> Buffer:
        """Return a buffer for shaders to fill, in memory that the CPU reads through a mapping."""
        return self._buffer(size, "readback", name)

    def download(self, buffer: Buffer) -> np.ndarray:
        """Return a copy of a buffer's bytes, (size,) uint8, after waiting for the shaders that fill it.

        Shader writes are visible to calls that read buffers only after the barrier of that name.
        """
        self.device.make_current()
        self.device.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return read_buffer(self.device, buffer)
