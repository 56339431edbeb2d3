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
from ..frames.frame import SLOTS
from ..frames.gl_commands import Commands
from ..pipelines.description import Built
from .kernels import COUNTERS, IN_SLOT, LISTS, OVERLAY, PYRAMIDS, TRANSPARENT, Kernels, OverlayDraw

OVERLAY_BINDING = 5
"""The first storage block of overlay.glsl that no draw of the scene uses."""


class CullingKernels(Kernels):
    """The buffers by name, bound to each kernel one by one."""

    def __init__(self, backend: GlBackend) -> None:
        super().__init__(backend)
        self._context = backend.device
        self._buffers: dict[str, Buffer] = {}
        self._depth = ""

    # --- memory ---

    def make_buffers(self, sizes: Mapping[str, int], contents: Mapping[str, np.ndarray]) -> None:
        """Create new buffers of these sizes in bytes; OpenGL itself frees earlier ones after their last use."""
        self._free(but=COUNTERS)
        for name, size in sizes.items():
            if name not in IN_SLOT:
                self._buffers[name] = create_buffer(self._context, size, "device", f"culling {name}")
                continue
            for slot in range(SLOTS):
                if (key := f"{name} {slot}") not in self._buffers:
                    self._buffers[key] = create_buffer(self._context, size, IN_SLOT[name], f"culling {key}")
        for name, table in contents.items():
            write_buffer(self._context, self._buffers[name], table)

    def _own(self, name: str) -> Buffer | None:
        return self._buffers.get(name)

    def make_bindings(
        self, kernels: Mapping[str, Built], meshlets: Built | None, overlay: Built | None, depth: str
    ) -> None:
        """Note the depth that the graph has now: programs have no descriptor sets."""
        self._depth = depth

    # --- frames ---

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        counters: NDArray[np.uint32] = self._buffer("told", slot).view(np.uint32).copy()
        return counters

    def bind(self, commands: Commands, kind: str, pipeline: Built, slot: int) -> None:
        """Bind a program with the buffers of its kind."""
        commands.bind_compute(pipeline)
        if kind in PYRAMIDS:
            image = self._backend.executor.images.image(slot, self._depth)
            assert isinstance(image, Image), self._depth
            sampler = self._backend.data.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0)
            bind_texture(self._context, 0, image.view, sampler)
            bind_buffer(self._context, "storage", 0, self._buffer(kind))
            return
        names = LISTS if kind == "lists" else TRANSPARENT
        bind_buffer(self._context, "uniform", 0, self._buffer("view", slot))
        self._backend.data.bind_instances(slot, len(names) - 1)
        for binding, name in enumerate(names[2:], start=1):
            bind_buffer(self._context, "storage", binding, self._buffer(name, slot))

    def draw_overlay(self, commands: Commands, slot: int, draw: OverlayDraw) -> None:
        """Record a draw of the overlay; the frame and the instances are bound for the whole frame."""
        commands.bind_pipeline(draw.pipeline)
        bind_buffer(self._context, "uniform", 1, self._buffer("view", slot))
        for binding, name in enumerate(OVERLAY[3:], OVERLAY_BINDING):
            bind_buffer(self._context, "storage", binding, self._buffer(name, slot))
        commands.push(draw.pipeline, draw.constants)
        self._context.fn.glBindVertexArray(self._backend.pipelines.no_vertices)
        self._context.fn.glDrawArraysInstanced(gl.GL_TRIANGLES, 0, draw.vertices, draw.instances)
        commands.work["draws"] += 1
        commands.work["draw_calls"] += 1

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU, and bind the scene's buffers again, which the kernels replaced."""
        self._context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        self._backend.data.bind_frame(slot)

    def _free(self, but: str = "-") -> None:
        for name in [name for name in self._buffers if not name.startswith(but)]:
            destroy_buffer(self._context, self._buffers.pop(name))

    def close(self) -> None:
        """Free the buffers."""
        self._free()
