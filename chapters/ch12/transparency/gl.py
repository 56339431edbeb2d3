"""The memory of layers on OpenGL: buffers and images, bound one by one; compare vulkan.py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backends.gl import api as gl
from backends.gl.resources import (
    Buffer,
    Image,
    MemoryUse,
    bind_buffer,
    bind_storage_image,
    create_buffer,
    destroy_buffer,
)

from ..frames.backend.gl import GlBackend
from ..frames.commands import DrawGroup, SceneBinding
from ..frames.frame import SLOTS
from ..frames.gl_commands import Commands
from ..pipelines.description import Built
from .kernels import IN_SLOT, KINDS, Bound, Kernels

FIRST_BINDING = 9
"""The first storage block of `pool.glsl`, behind all that draws of the scene bind."""


class LayerKernels(Kernels):
    """The buffers by name, and the names of the images."""

    def __init__(self, backend: GlBackend) -> None:
        super().__init__(backend)
        self._context = backend.device
        self._buffers: dict[str, Buffer] = {}
        self._images: tuple[str, ...] = ()
        self._lists = False

    def why_not(self) -> str:
        """Return "": OpenGL 4.3 has all that lists need."""
        return ""

    # --- memory ---

    def make_buffers(self, sizes: Mapping[str, int]) -> None:
        """Create buffers of these sizes in bytes; OpenGL itself frees earlier ones after their last use."""
        self._free([name for name in self._buffers if name in sizes])
        for name, size in sizes.items():
            for key in [f"{name} {slot}" for slot in range(SLOTS)] if name in IN_SLOT else [name]:
                if key not in self._buffers:
                    use: MemoryUse = IN_SLOT.get(name, "device")
                    self._buffers[key] = create_buffer(self._context, size, use, f"layers {key}")

    def make_bindings(self, bound: Bound) -> None:
        """Note the images that the graph has now: programs have no descriptor sets."""
        self._images, self._lists = bound.images, bound.lists

    # --- frames ---

    def bind(self, commands: Commands, kind: str, pipeline: Built) -> None:
        """Bind a program with the buffers and images of its kind."""
        commands.bind_compute(pipeline)
        slot = commands.slot.index
        self._bind_buffers(kind, slot)
        for unit, name in enumerate(self._images if kind == "resolve" else ()):
            image = self._backend.executor.images.image(slot, name)
            assert isinstance(image, Image), name
            bind_storage_image(self._context, unit, image, access="both" if unit == 0 else "read")

    def draw(self, commands: Commands, kind: str, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene after the buffers of a kind, which have numbers of their own."""
        self._bind_buffers(kind, commands.slot.index)
        commands.draw_groups(groups, scene)

    def _bind_buffers(self, kind: str, slot: int) -> None:
        for binding, name in enumerate(KINDS[kind] if self._lists else (), FIRST_BINDING):
            key = f"{name} {slot}" if name in IN_SLOT else name
            bind_buffer(self._context, "storage", binding, self._buffers[key])

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the counters visible to the CPU."""
        self._context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        counters: NDArray[np.uint32] = self._buffers[f"told {slot}"].view(np.uint32).copy()
        return counters

    # --- life ---

    def _free(self, names: list[str]) -> None:
        for name in names:
            destroy_buffer(self._context, self._buffers.pop(name))

    def close(self) -> None:
        """Free the buffers."""
        self._free([*self._buffers])
