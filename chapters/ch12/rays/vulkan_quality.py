"""Which structures of the driver are due for a rebuild, by a figure that needs no look into them.

A driver does not tell the boxes of its structures. So a kernel measures, behind each refit, how large groups of
neighbours in the order of the triangles are (vulkan_quality.comp). That order was made for the shape at the beginning:
where the figure has risen, or has fallen again after a rebuild, the tree fits another shape than the one that is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer

from ..frames.backend.vulkan import VulkanBackend
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.vulkan_descriptors import Held
from .bvh.quality import Watch
from .bvh.vulkan_told import Told
from .settings import RaySettings

KERNEL = ComputeDescription("rays/vulkan_quality.comp", name="ray shapes")
NEIGHBOURS = 8
"""Triangles of a group, as in the kernel."""


@dataclass(frozen=True)
class Shape:
    """A structure that is refitted: the first word of its indices, its number of triangles, the page of its positions
    and their first word there, and the figure at the build."""

    indices: int
    triangles: int
    page: int
    positions: int
    figure: float


def figure_of(corners: NDArray[np.floating]) -> float:
    """Return the figure of triangles (T, 3, 3) in the order of a structure; 0 without extent. Corners are finite."""
    if not len(corners):
        return 0.0
    firsts = np.arange(0, len(corners), NEIGHBOURS)
    low = np.minimum.reduceat(corners.min(axis=1).astype(np.float64), firsts)
    high = np.maximum.reduceat(corners.max(axis=1).astype(np.float64), firsts)

    def area(size: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = np.moveaxis(size, -1, 0)
        surface: NDArray[np.float64] = x * y + y * z + z * x
        return surface

    all_ = float(area(high.max(axis=0) - low.min(axis=0)))
    return float(area(high - low).sum()) / all_ if all_ > 0 else 0.0


class ShapeReports:
    """The figures of structures, and which of them a frame builds anew (`rebuilds`, places in `shapes`)."""

    def __init__(
        self, backend: VulkanBackend, shapes: Sequence[Shape], indices: Buffer, settings: RaySettings
    ) -> None:
        self._descriptors = backend.descriptors
        self._shapes = shapes
        sizes = [shape.triangles for shape in shapes]
        self._watch = Watch(
            sizes,
            [shape.figure for shape in shapes],
            [NEIGHBOURS] * len(shapes),
            settings.ray_rebuild,
            settings.ray_rebuild_budget,
            either_way=True,
        )
        self.rebuilds: tuple[int, ...] = ()
        (self._kernel,) = backend.pipelines.get([KERNEL])
        self._told = Told(backend.device, len(shapes), "figures")
        layout = self._kernel.sets[0]
        assert layout is not None, "the kernel has buffers"
        keys = [(slot, page) for slot in range(SLOTS) for page in sorted({shape.page for shape in shapes})]
        described = []
        for slot, page in keys:
            held: dict[int, Held] = {
                0: indices,
                1: backend.data.page_buffer(slot, page),
                2: self._told.buffers[slot],
            }
            described.append((layout, held, f"ray shapes, slot {slot}, page {page}"))
        self._sets = self._descriptors.create(described)
        handles = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]
        self._set_of = dict(zip(keys, handles, strict=True))

    @property
    def percent(self) -> int:
        """The largest change that the last report had, in percent."""
        return self._watch.worst_percent

    def follow(self, slot: int) -> tuple[int, ...]:
        """Read what the last frame of the slot has measured; return what this frame builds anew."""
        if self._watch.asks(slot):
            self._watch.take(slot, self._told.read(slot))
        self.rebuilds = self._watch.due()
        return self.rebuilds

    def ask(self, slot: int) -> None:
        """Note that the frame measures."""
        self._watch.ask(slot, True)

    def record(self, commands: Commands, slot: int) -> None:
        """Record the kernel for each structure, behind the refits."""
        commands.compute_barrier()
        commands.bind_compute(self._kernel)
        for place in self._watch.watched:
            shape = self._shapes[place]
            commands.bind_compute_set(self._kernel, 0, self._set_of[slot, shape.page])
            push = (shape.indices, shape.triangles, shape.positions, place)
            commands.push(self._kernel, np.array(push, np.uint32))
            commands.dispatch(1)
        self._told.finish(commands)

    def close(self) -> None:
        """Free everything; no frame in flight uses it."""
        self._descriptors.destroy(self._sets)
        self._told.close()


def shape_reports(
    backend: VulkanBackend, shapes: Sequence[Shape], indices: Buffer, settings: RaySettings | None
) -> Any:
    """Return the reports of structures that are refitted, or None where none of them is ever built anew."""
    if settings is None or settings.ray_rebuild <= 0 or not shapes:
        return None
    return ShapeReports(backend, shapes, indices, settings)
