"""Recording of compute work: what `Commands` knows beside draws.

Compute has its own bind point, so that what draws have bound stays bound. Nothing of this may stand between
`begin_rendering` and `end_rendering`. Barriers between passes are the graph's; one between two dispatches of the same
pass, where the second reads what the first wrote, is the pass's own: `compute_barrier`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers

from ..pipelines.description import Built
from .commands import SceneBinding
from .dispatches import group_count

_COMPUTE = vk.VK_PIPELINE_BIND_POINT_COMPUTE

_WRITES = vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
_READS = (
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT
    | vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT
    | vk.VK_ACCESS_2_UNIFORM_READ_BIT
)
_STAGE = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT
_ONE_AFTER_ANOTHER = barriers(memory=(_STAGE, _WRITES, _STAGE, _READS | _WRITES))


class Dispatches:
    """The compute half of `Commands`."""

    _fn: Any
    handle: Any
    sources: Any
    work: dict[str, int]

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Bind the pipeline that the next dispatches run, the set of the scene if given, and that of the sources."""
        self._fn.vkCmdBindPipeline(self.handle, _COMPUTE, pipeline.handle)
        self.work["pipeline_binds"] += 1
        if scene is not None and pipeline.sets[0] is not None:
            self.bind_compute_set(pipeline, 0, scene.computed)
        if self.sources is not None:
            self.bind_compute_set(pipeline, *self.sources)

    def bind_compute_set(self, pipeline: Built, number: int, descriptor_set: Any) -> None:
        """Bind an array of one descriptor set as set `number` of compute."""
        self._fn.vkCmdBindDescriptorSets(
            self.handle, _COMPUTE, pipeline.layout, number, 1, descriptor_set, 0, vk.NULL
        )
        self.work["descriptor_binds"] += 1

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants, from their first byte on, to what a recording fixes; none where none are taken."""
        if not pipeline.push_stages:
            return
        raw = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
        self._fn.vkCmdPushConstants(
            self.handle, pipeline.layout, pipeline.push_stages, 0, raw.size, vk.ffi.from_buffer(raw)
        )

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run work groups of the pipeline that is bound."""
        self._fn.vkCmdDispatch(self.handle, x, y, z)
        self.work["dispatches"] += 1

    def dispatch_over(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run as many groups as cover `extent`, 1 to 3 numbers of invocations: pixels, or elements of an array."""
        self.dispatch(*group_count(extent, pipeline.group))

    def compute_barrier(self) -> None:
        """Let the dispatches behind this wait for those before it, and see what they stored."""
        self._fn.vkCmdPipelineBarrier2(self.handle, _ONE_AFTER_ANOTHER)
