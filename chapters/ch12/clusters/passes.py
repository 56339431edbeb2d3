"""The pass that builds the light lists, before the passes that light surfaces.

    bounds -> order -> bins, tiles

Lists are built anew in every frame that is drawn, since lights and camera may move.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..frames.commands import Commands
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.views import has_lit
from . import model
from .model import BINS, GROUP, ListLayout

LISTS = "light_lists"
"""The resource in the graph: the buffer of the lists."""

LIT = (
    *("forward", "forward_late", "transparent", "transparent_fill"),
    *("lighting", "lighting_compute", "lighting_blocks", "lighting_pixels"),
)
"""The passes that loop over lights."""

_READ = Touch("", frozenset({"fragment", "compute"}), frozenset({"storage_read"}))
"""The last use in the frame before."""


class ListBuffer:
    """The buffer of the lists, which the scene's data binds for all shaders."""

    def __init__(self, backend: Backend) -> None:
        self._backend: Any = backend
        limit = int(backend.device.capabilities.limits["maxStorageBufferRange"])
        self.most_bytes = min(limit, 1 << 30)
        """The largest buffer that shaders see."""

    def make(self, size: int) -> None:
        """Create the buffer with `size` bytes; an earlier one is freed after its last use."""
        self.close()
        self._backend.data.light_lists = self._created(size)

    def close(self) -> None:
        """Free the buffer."""
        data = self._backend.data
        if data.light_lists is not None:
            self._destroy(data.light_lists)
        data.light_lists = None

    def _created(self, size: int) -> Any:
        raise NotImplementedError

    def _destroy(self, buffer: Any) -> None:
        raise NotImplementedError


class LightListsPass(Pass):
    """Sorts the lights by depth, then finds those of each bin of depth and those over each tile."""

    name = "light_lists"

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._draws, self._pipelines = parts.settings, parts.draws, parts.pipelines
        self.layout: ListLayout | None = None
        """The layout of the buffer, from the first frame on."""
        self.writes = (Access(LISTS, "storage", bytes=4),)
        self.externals = {LISTS: External(None, None, _READ, bytes=4)}

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there are lights enough, and surfaces that they light."""
        return model.needed(scene, settings) and has_lit(scene, settings)

    def create(self) -> None:
        """Build the kernels that the setting `light_lists` needs."""
        lists = self._settings.clusters.light_lists
        names = ["bounds", "order"]
        names += ["bins"] * (lists in ("bins", "clusters")) + ["tiles"] * (lists in ("tiles", "clusters"))
        described = [ComputeDescription(f"clusters/{name}.comp", name=f"light {name}") for name in names]
        self.pipelines = self._pipelines.get(described)

    def record(self, commands: Commands) -> None:
        """Record the kernels; bins and tiles both follow from the order, and run side by side."""
        layout = self.layout
        assert layout is not None, "a frame was prepared"
        across, down = layout.tiles
        over_lights = (-(-layout.lights // GROUP), 1, 1)
        groups = {
            "light bounds": over_lights,
            "light order": over_lights,
            "light bins": (BINS, 1, 1),
            "light tiles": (-(-across // 8), -(-down // 8), layout.words_of_set),
        }
        for number, pipeline in enumerate(self.pipelines):
            if number in (1, 2):
                commands.compute_barrier()
            commands.bind_compute(pipeline, self._draws.binding)
            commands.push(pipeline, np.array([layout.pushed], np.uint32))
            commands.dispatch(*groups[pipeline.described.name])

    def key(self, slot: int) -> Any:
        """Return the layout of the buffer."""
        return self.layout


def read_lists(passes: Collection[Pass]) -> None:
    """Declare in the passes that light surfaces that they read the lists."""
    for gpu_pass in passes:
        gpu_pass.reads = (*gpu_pass.reads, Access(LISTS, "storage"))
