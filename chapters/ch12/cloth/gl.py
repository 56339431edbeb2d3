"""Cloth on OpenGL: buffers and their bindings; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
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

from ..frames.backend.gl import GlBackend
from ..frames.frame import SLOTS
from ..frames.gl_commands import Commands
from ..pipelines.description import Built
from .dispatches import Kernel
from .layout import Limits, Packed
from .passes import FRAME, STATE


class ClothBuffers:
    """The buffers by name; those of FRAME exist once per slot."""

    def __init__(self, context: Context, packed: Packed, before: ClothBuffers | None = None) -> None:
        self._context = context
        sizes = packed.sizes()
        self._by_name: dict[str, Buffer] = {}
        if before is not None:
            self._by_name = {name: before._by_name.pop(name) for name in STATE}
            before.close()
        for name, array in packed.arrays.items():
            if name not in self._by_name:
                self._by_name[name] = create_buffer(context, sizes[name], "device", f"cloth {name}")
                write_buffer(context, self._by_name[name], array)
        for name, use in FRAME.items():
            for slot in range(SLOTS):
                buffer = create_buffer(context, sizes[name], use, f"cloth {name}, slot {slot}")
                self._by_name[f"{name} {slot}"] = buffer

    def buffer(self, name: str, slot: int = 0) -> Buffer:
        """Return a buffer by its name; of a buffer of FRAME, that of the slot."""
        return self._by_name[f"{name} {slot}" if name in FRAME else name]

    def stats(self, slot: int) -> NDArray[np.uint8]:
        """Return the bytes that the last frame of a slot wrote about each cloth."""
        return self.buffer("stats", slot).mapped.copy()

    def read(self, name: str) -> NDArray[np.float32]:
        """Return the contents of a buffer that exists once; OpenGL itself waits for the frames."""
        self._context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        contents: NDArray[np.float32] = read_buffer(self._context, self.buffer(name), np.float32)
        return contents

    def write(self, slot: int, arrays: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write the input of a frame."""
        for name, data in arrays.items():
            self.buffer(name, slot).mapped[: data.size] = data

    def close(self) -> None:
        """Free the buffers: OpenGL itself waits for the GPU's use."""
        for buffer in self._by_name.values():
            destroy_buffer(self._context, buffer)
        self._by_name = {}


class ClothKernels:
    """Buffers, bound to each kernel one by one."""

    def __init__(self, backend: GlBackend) -> None:
        self._context, self._data, self._pipelines = backend.device, backend.data, backend.pipelines
        limits = backend.device.limits
        self.limits = Limits(
            limits["maxStorageBufferRange"],
            invocations=limits["maxComputeWorkGroupInvocations"],
            shared_bytes=limits["maxComputeSharedMemorySize"],
        )

    def make_memory(self, packed: Packed, before: ClothBuffers | None) -> ClothBuffers:
        """Return the buffers, with the state of `before`."""
        self._buffers = ClothBuffers(self._context, packed, before)
        return self._buffers

    def make_kernels(self, kernels: Mapping[Kernel, Built], pages: Collection[int]) -> None:
        """Make nothing: programs have no descriptor sets."""

    def bind(self, commands: Commands, kernel: Kernel, slot: int, page: int) -> None:
        """Bind the buffers of a kernel."""
        for binding, name in enumerate(kernel.buffers):
            words = name == "words"
            buffer = self._data.page_buffer(slot, page) if words else self._buffers.buffer(name, slot)
            bind_buffer(self._context, "storage", binding, buffer)

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the stats visible to the CPU, and bind the scene's buffers again, which the kernels replaced."""
        self._context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        self._data.bind_frame(slot)

    @contextmanager
    def at_once(self, slot: int) -> Iterator[Commands]:
        """Yield commands for a slot that run at once; the next frame reads their results."""
        self._context.wait_idle()
        commands = Commands(self._context, self._pipelines, multi_draw=False)
        frame_slot: Any = SimpleNamespace(index=slot)
        commands.begin(frame_slot)
        yield commands
        commands.compute_barrier()
