"""The layers' memory while a renderer is open: it follows the size of the picture, the graph and the pipelines."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..culling.lists import folded
from ..frames.commands import Commands
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..scene.pass_parts import PassParts
from .kernels import RESOLVED, TOLD_WORDS, Bound, Kernels
from .model import RUN, blocks_of, capacity_of, sizes_of, uses_lists


class LayerMemory:
    """What the passes of transparency share."""

    def __init__(self, parts: PassParts, kernels: Kernels, backend: Any) -> None:
        self._parts, self.kernels, self._backend = parts, kernels, backend
        self._nodes = parts.settings.transparency.nodes
        self.lists = uses_lists(parts.settings)
        self._pipelines: dict[str, Built] = {}
        self._size: tuple[int, int] | None = None
        self._bound: Any = None
        self.capacity = 0
        """The layers that the pool holds."""
        self.revision = 0
        """Grows with every change of the buffers or the bindings."""

    @property
    def is_made(self) -> bool:
        """Whether there are buffers or bindings."""
        return self._bound is not None or self._size is not None

    def set_pipeline(self, kind: str, pipeline: Built) -> None:
        """Take note of a pipeline: all of a kind have one layout of the set that this memory fills."""
        self._pipelines[kind] = pipeline
        self._bound = None

    def build(self, kind: str, *described: ComputeDescription) -> list[Built]:
        """Build the compute pipelines of a kind."""
        built = self._parts.pipelines.get(described)
        self.set_pipeline(kind, built[0])
        return built

    def prepare(self, size: tuple[int, int]) -> None:
        """Follow the size of the picture and the graph."""
        executor = self._backend.executor
        if self._bound == (executor, size):
            return
        if self.lists and size != self._size:
            self.capacity = capacity_of(size, self._nodes, self.kernels.buffer_bytes)
            self.kernels.make_buffers(sizes_of(size, self.capacity) | {"told": 4 * TOLD_WORDS})
            self._size = size
        names = executor.graph.names
        images = tuple(names[name] for name in RESOLVED)
        self.kernels.make_bindings(Bound(self._pipelines, images, self.lists))
        self._bound = executor, size
        self.revision += 1

    # --- recording ---

    def run(self, commands: Commands, kind: str, pipeline: Built, blocks: int | None = None) -> None:
        """Record a kernel over all blocks of pixels, or over a number of them."""
        assert self._size is not None, "it was prepared"
        width, height = self._size
        all_blocks = blocks_of(width * height)
        self.kernels.bind(commands, kind, pipeline)
        commands.push(pipeline, np.array([[width * height, width, self.capacity, all_blocks]], np.uint32))
        commands.dispatch(*folded(all_blocks if blocks is None else blocks))

    # --- counters and life ---

    def told(self, slot: int) -> dict[str, int]:
        """Return the counters of a slot's last frame."""
        layers, capacity, overflow = self.kernels.told(slot)[:3].tolist()
        return {
            "transparent_fragments": layers,
            "transparent_capacity": capacity,
            "transparent_overflow": overflow,
        }

    def close(self) -> None:
        """Free buffers and bindings."""
        self.kernels.close()
        self._size = self._bound = None


RUNS = (("RUN", f"{RUN}u"),)
"""The define of kernels over blocks."""
