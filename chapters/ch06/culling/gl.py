"""Culling on OpenGL: buffers and their bindings; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import (
    Buffer,
    Image,
    bind_buffer,
    bind_texture,
    create_buffer,
    destroy_buffer,
    write_buffer,
)
from common.scene import Sampler

from ..frames.backend.gl import GlBackend
from ..frames.commands import Counted, MeshDraw
from ..frames.frame import SLOTS
from ..frames.gl_commands import Commands
from ..meshlets.model import SceneMeshlets
from ..pipelines.description import Built
from .kernels import CLEARED, IN_SLOT, LISTS, TRANSPARENT, cleared, sizes_of, tables_of
from .lists import CullingLists


class CullingKernels:
    """The buffers by name, bound to each kernel one by one."""

    def __init__(self, backend: GlBackend) -> None:
        self._backend, self._context = backend, backend.device
        self.counts_draws = backend.plan.native("draw-indirect-count")
        self._buffers: dict[str, Buffer] = {}
        self._depth = ""

    # --- memory ---

    def make_lists(
        self,
        lists: CullingLists,
        meshlets: SceneMeshlets | None,
        instances: int,
        copied: int,
        pyramid_words: int,
    ) -> None:
        """Create the buffers of new tables; OpenGL itself frees earlier ones after their last use."""
        self.close()
        tables = tables_of(lists, meshlets)
        sizes = sizes_of(lists, tables, pyramid_words, instances, copied)
        for name, size in sizes.items():
            if name not in IN_SLOT:
                self._buffers[name] = create_buffer(self._context, size, "device", f"culling {name}")
                continue
            for slot in range(SLOTS):
                buffer = create_buffer(self._context, size, IN_SLOT[name], f"culling {name}, slot {slot}")
                self._buffers[f"{name} {slot}"] = buffer
        for name, table in tables.items():
            write_buffer(self._context, self._buffers[name], table)
        for name in CLEARED:
            write_buffer(self._context, self._buffers[name], cleared(self._buffers[name].size))

    def _buffer(self, name: str, slot: int = 0) -> Buffer:
        if name == "instances":
            buffer: Buffer = self._backend.data.slots[slot].instances  # type: ignore[assignment]
            return buffer
        if name == "source":
            return self._backend.data.slots[slot].commands
        if name == "seen":
            return self._buffer("visible", 1 - slot)
        return self._buffers[f"{name} {slot}" if name in IN_SLOT else name]

    def make_bindings(self, kernels: Mapping[str, Built], meshlets: Built | None, depth: str) -> None:
        """Note the depth that the graph has now: programs have no descriptor sets."""
        self._depth = depth

    # --- frames ---

    def write_view(self, slot: int, constants: NDArray[np.uint8]) -> None:
        """Write the view of culling for a slot."""
        self._buffer("view", slot).mapped[: len(constants)] = constants

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        counters: NDArray[np.uint32] = self._buffer("told", slot).view(np.uint32).copy()
        return counters

    def bind(self, commands: Commands, kind: str, pipeline: Built, slot: int) -> None:
        """Bind a program with the buffers of its kind."""
        commands.bind_compute(pipeline)
        if kind == "pyramid":
            image = self._backend.executor.images.image(slot, self._depth)
            assert isinstance(image, Image), self._depth
            sampler = self._backend.data.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0)
            bind_texture(self._context, 0, image.view, sampler)
            bind_buffer(self._context, "storage", 0, self._buffer("pyramid"))
            return
        names = LISTS if kind == "lists" else TRANSPARENT
        bind_buffer(self._context, "uniform", 0, self._buffer("view", slot))
        self._backend.data.bind_instances(slot, len(names) - 1)
        for binding, name in enumerate(names[2:], start=1):
            bind_buffer(self._context, "storage", binding, self._buffer(name, slot))

    def dispatch(self, commands: Commands, word: int) -> None:
        """Dispatch the groups whose numbers are in three words of `state`."""
        commands.dispatch_indirect(self._buffer("state"), 4 * word)

    def counted(self, word: int) -> Counted:
        """Return the draw commands with the word of `state` that holds their number."""
        return Counted(self._buffer("commands"), self._buffer("state"), 4 * word, self.counts_draws)

    def mesh_draw(self, slot: int, constants: NDArray[np.uint32], word: int) -> MeshDraw:
        """Raise AssertionError: OpenGL has no mesh shaders."""
        raise AssertionError("OpenGL has no mesh shaders")

    def target(self, slot: int) -> Buffer:
        """Return the draw commands of blended objects."""
        return self._buffer("target", slot)

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU, and bind the scene's buffers again, which the kernels replaced."""
        self._context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        self._backend.data.bind_frame(slot)

    def close(self) -> None:
        """Free the buffers."""
        for buffer in self._buffers.values():
            destroy_buffer(self._context, buffer)
        self._buffers = {}
