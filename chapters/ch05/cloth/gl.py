"""The cloth pass on OpenGL: the same kernels in the same order; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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

from ..frames.frame import SLOTS
from ..frames.gl_commands import Commands
from ..pipelines.gl import Built, Pipelines
from ..pipelines.gl_compute import ComputePipeline
from ..scene.gl_data import SceneData
from ..settings import Settings
from .declared import FRAME, STATE, ClothSteps, title
from .dispatches import Dispatch, Kernel
from .layout import Limits, Packed
from .scene import ClothScene


class ClothBuffers:
    """The buffers by name; those that a frame writes and answers in exist once per slot."""

    def __init__(self, context: Context, packed: Packed, before: ClothBuffers | None = None) -> None:
        self._context = context
        sizes = packed.sizes()
        self._held: dict[str, Buffer] = {}
        if before is not None:
            self._held = {name: before._held.pop(name) for name in STATE}
            before.close()
        for name, array in packed.arrays.items():
            if name not in self._held:
                self._held[name] = create_buffer(context, sizes[name], "device", f"cloth {name}")
                write_buffer(context, self._held[name], array)
        for name, use in FRAME.items():
            for slot in range(SLOTS):
                made = create_buffer(context, sizes[name], use, f"cloth {name}, slot {slot}")
                self._held[f"{name} {slot}"] = made

    def buffer(self, name: str, slot: int = 0) -> Buffer:
        """Return a buffer by its name, where there are several that of a slot."""
        return self._held[f"{name} {slot}" if name in FRAME else name]

    def stats(self, slot: int) -> NDArray[np.uint8]:
        """Return the bytes that the last frame of a slot wrote about each cloth."""
        return self.buffer("stats", slot).mapped.copy()

    def read(self, name: str) -> NDArray[np.float32]:
        """Return what is in a buffer that stays; OpenGL itself waits for the frames."""
        self._context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found: NDArray[np.float32] = read_buffer(self._context, self.buffer(name), np.float32)
        return found

    def write(self, slot: int, arrays: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write what a frame asks for."""
        for name, data in arrays.items():
            self.buffer(name, slot).mapped[: data.size] = data

    def close(self) -> None:
        """Free the buffers: OpenGL itself waits for the GPU's use."""
        for buffer in self._held.values():
            destroy_buffer(self._context, buffer)
        self._held = {}


class ClothPass(ClothSteps):
    """Simulation, normals and vertices of all cloths."""

    def __init__(
        self, found: ClothScene, settings: Settings, data: SceneData, pipelines: Pipelines, context: Context
    ) -> None:
        limits = context.limits
        super().__init__(
            found,
            settings,
            data,
            Limits(
                limits["maxStorageBufferRange"],
                invocations=limits["maxComputeWorkGroupInvocations"],
                shared_bytes=limits["maxComputeSharedMemorySize"],
            ),
        )
        self._scene_data, self._pipelines, self._context = data, pipelines, context
        self._made: dict[Kernel, Built] = {}

    def make_memory(self, packed: Packed, before: Any) -> ClothBuffers:
        """Return the buffers, whose state is that of `before`."""
        self._buffers = ClothBuffers(self._context, packed, before)
        return self._buffers

    def make_kernels(self, kernels: list[Kernel]) -> None:
        """Make the programs."""
        described = [ComputePipeline(one.file, tuple(one.defines.items()), title(one)) for one in kernels]
        self._made = dict(zip(kernels, self._pipelines.get(described), strict=True))

    @contextmanager
    def at_once(self, slot: int) -> Iterator[Commands]:
        """Give commands for a slot that run at once; what they write is there for the next frame."""
        self._context.wait_idle()
        commands = Commands(self._context, self._pipelines, multi_draw=False)
        where: Any = SimpleNamespace(index=slot)
        commands.begin(where)
        yield commands
        commands.compute_barrier()

    def record(self, commands: Commands) -> None:
        """Make the dispatches of this frame, each behind those whose results it reads."""
        slot = commands.slot.index
        bound: Dispatch | None = None
        for one in self.dispatched(slot):
            if bound is None or one.kernel != bound.kernel:
                commands.bind_compute(self._made[one.kernel])
            if bound is None or (one.kernel, one.page) != (bound.kernel, bound.page):
                for binding, name in enumerate(one.kernel.buffers):
                    words = name == "words"
                    held = (
                        self._scene_data.page_buffer(slot, one.page)
                        if words
                        else self._buffers.buffer(name, slot)
                    )
                    bind_buffer(self._context, "storage", binding, held)
            bound = one
            if one.after:
                commands.compute_barrier()
            commands.push(np.array(one.push, np.uint32))
            commands.dispatch(*one.groups)
        if bound is not None:
            self._context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
            self._scene_data.bind_frame(slot)
