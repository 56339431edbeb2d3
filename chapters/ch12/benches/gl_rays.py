"""Kernels and buffers of the bench of rays on OpenGL; compare vulkan_rays.py."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import (
    Buffer,
    bind_buffer,
    create_buffer,
    destroy_buffer,
    read_buffer,
    write_buffer,
)

from ..frames.gl_commands import Commands
from ..pipelines.description import Built, Described
from ..pipelines.gl import Pipelines


class Gpu:
    """What runs the bench's kernels in a context; `close` frees all that it made."""

    ways: tuple[str, ...] = ()
    """OpenGL has no acceleration structures."""

    def __init__(self, device: Context) -> None:
        self.device = device
        device.make_current()
        self.pipelines = Pipelines(device)
        self._commands = Commands(device, self.pipelines, True)
        self._buffers: list[Buffer] = []

    def buffer(self, array: NDArray[Any], name: str) -> Buffer:
        """Return a buffer in the GPU's own memory with this content."""
        raw = np.ascontiguousarray(array).view(np.uint8).reshape(-1)
        buffer = create_buffer(self.device, raw.size, "device", f"bench: {name}")
        self._buffers.append(buffer)
        write_buffer(self.device, buffer, raw)
        return buffer

    def read(self, buffer: Buffer, dtype: Any) -> NDArray[Any]:
        """Return a copy of a buffer's content."""
        self.device.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return read_buffer(self.device, buffer, dtype)

    def kernel(self, described: Described) -> Built:
        """Return the program of a description."""
        return self.pipelines.get([described])[0]

    def bound(self, kernel: Built, held: Mapping[int, Buffer]) -> Any:
        """Return what `seconds` binds: buffers by binding."""
        return dict(held)

    def seconds(self, calls: Sequence[tuple[Built, Any, int, Sequence[int]]], times: int = 1) -> float:
        """Run calls (kernel, bound, invocations, push), one after the other; return the seconds of all, waited for.

        With `times` they run so often, and the seconds are those of once.
        """
        commands, fn = self._commands, self.device.fn
        began = clock.perf_counter()
        slot: Any = SimpleNamespace()
        commands.begin(slot)
        for _ in range(times):
            for kernel, bound, invocations, push in calls:
                commands.bind_compute(kernel)
                for binding, buffer in bound.items():
                    bind_buffer(self.device, "storage", binding, buffer)
                commands.push(kernel, np.array(push, np.uint32))
                commands.trace(kernel, (invocations,))
                commands.compute_barrier()
        fn.glFinish()
        return (clock.perf_counter() - began) / times

    def close(self) -> None:
        """Free everything."""
        for buffer in self._buffers:
            destroy_buffer(self.device, buffer)
        self.pipelines.close()


Driver: Any = None
"""The structures of the driver, of which OpenGL has none."""
