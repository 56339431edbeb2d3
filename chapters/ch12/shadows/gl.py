"""The memory of shadows on OpenGL; compare vulkan.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.gl.resources import (
    Buffer,
    Image,
    bind_buffer,
    bind_texture,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    write_buffer,
)
from backends.gl.targets import Attachment, create_framebuffer, destroy_framebuffer

from ..frames.frame import SLOTS
from ..frames.gl_commands import Rendering
from ..pipelines.description import Built
from .lists import ShadowLists
from .memory import NEAREST, TABLES
from .memory import ShadowMemory as _ShadowMemory

DRAWN_UNIT = 16
"""The texture unit of the kernel, behind those of materials."""

FIRST_TABLE = 5
"""The first storage block of the tables: what is before it is bound for the whole frame."""


@dataclass
class _Target:
    image: Image
    layers: list[Rendering]


class ShadowMemory(_ShadowMemory):
    """Buffers, images and framebuffers that this object owns."""

    def _create(self) -> None:
        context = self._backend.device
        self.blocks: list[Buffer] = [
            create_buffer(context, self.layout.size, "upload", f"shadows, slot {slot}")
            for slot in range(SLOTS)
        ]
        self._tables: dict[str, Buffer] = {}

    def _create_target(self, size: int, layers: int) -> _Target:
        context, name = self._backend.device, f"shadow faces of {size}"
        image = create_image(context, "d32f", (size, size), name, shape="array", layers=layers)
        framebuffers = [
            create_framebuffer(context, [], Attachment(image, 0, layer), f"{name}, layer {layer}")
            for layer in range(layers)
        ]
        return _Target(image, [Rendering(framebuffer, (), 0.0) for framebuffer in framebuffers])

    # --- culling ---

    def make_lists(self, lists: ShadowLists) -> None:
        """Create the buffers of other lists; OpenGL itself frees earlier ones after their last use."""
        self._free_lists()
        context, contents, sizes = self._backend.device, lists.contents, lists.sizes
        for name in TABLES:
            self._tables[name] = create_buffer(context, lists.bytes_of(name), "device", f"shadow {name}")
            if name in contents and contents[name].nbytes:
                write_buffer(context, self._tables[name], contents[name])
        never = np.array([1 << 24], np.uint32)
        write_buffer(context, self._tables["numbers"], never, sizes["numbers"] - 4)

    def _table(self, name: str) -> Buffer:
        return self._tables[name]

    def bind_lists(self, commands: Any, kernel: Built) -> None:
        """Bind a kernel that culls; the buffer of the slot and its instances are bound for the whole frame."""
        commands.bind_compute(kernel)
        for binding, name in enumerate(TABLES, FIRST_TABLE):
            bind_buffer(self._backend.device, "storage", binding, self._tables[name])

    def _free_lists(self) -> None:
        for buffer in self._tables.values():
            destroy_buffer(self._backend.device, buffer)
        self._tables = {}

    # --- recording ---

    def store(self, commands: Any, kernel: Built, size: int, number: int) -> None:
        """Copy layers into the pages; the buffer and the pages are bound for the whole frame."""
        backend = self._backend
        commands.bind_compute(kernel)
        bind_texture(
            backend.device, DRAWN_UNIT, self._targets[size].image.view, backend.data.sampler(NEAREST, 1.0)
        )
        commands.push(kernel, np.array([[number, 0, 0, 0]], np.uint32))
        commands.dispatch_indirect(self.blocks[commands.slot.index], self.layout.rounds + 16 * number)

    def close(self) -> None:
        """Free everything; OpenGL itself waits for its last use."""
        context = self._backend.device
        self._free_lists()
        for block in self.blocks:
            destroy_buffer(context, block)
        for target in self._targets.values():
            for rendering in target.layers:
                destroy_framebuffer(context, rendering.target)
            destroy_image(context, target.image)
        self.blocks, self._targets = [], {}
