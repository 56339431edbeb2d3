"""Compute commands on Vulkan: the dispatches of `Commands`.

Compute has its own bind point, so the bindings of draws stay valid. None of these commands may stand between
`begin_rendering` and `end_rendering`. The graph sets the barriers between passes. If a dispatch reads what an earlier
dispatch of the same pass wrote, the pass itself calls `compute_barrier` between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers

from ..pipelines.description import Built
from .commands import SceneBinding
from .dispatches import DispatchCommands, check_rays

_COMPUTE = vk.VK_PIPELINE_BIND_POINT_COMPUTE
_RAYS = vk.VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR

_WRITES = vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
_READS = (
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT
    | vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT
    | vk.VK_ACCESS_2_UNIFORM_READ_BIT
)
_STAGE = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT
_ONE_AFTER_ANOTHER = barriers(
    memory=(
        _STAGE,
        _WRITES,
        _STAGE | vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT,
        _READS | _WRITES | vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT,
    )
)


class Dispatches(DispatchCommands):
    """The compute methods of `Commands`."""

    _fn: Any
    handle: Any

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Bind the pipeline of the next dispatches, the set of the scene if given, and the set of the sources."""
        point = _COMPUTE if pipeline.table is None else _RAYS
        self._fn.vkCmdBindPipeline(self.handle, point, pipeline.handle)
        self.work["pipeline_binds"] += 1
        if scene is not None and pipeline.sets[0] is not None:
            self.bind_compute_set(pipeline, 0, scene.frame)
        if self.sources is not None:
            self.bind_compute_set(pipeline, *self.sources)

    def bind_compute_set(self, pipeline: Built, number: int, descriptor_set: Any) -> None:
        """Bind an array of one descriptor set as set `number` of compute, or of rays for a pipeline of rays."""
        point = _COMPUTE if pipeline.table is None else _RAYS
        self._fn.vkCmdBindDescriptorSets(
            self.handle, point, pipeline.layout, number, 1, descriptor_set, 0, vk.NULL
        )
        self.work["descriptor_binds"] += 1

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants from their first byte on, to values fixed in a recording; do nothing without any."""
        if not pipeline.push_stages:
            return
        raw = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
        self._fn.vkCmdPushConstants(
            self.handle, pipeline.layout, pipeline.push_stages, 0, raw.size, vk.ffi.from_buffer(raw)
        )

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run x * y * z work groups of the bound pipeline."""
        self._fn.vkCmdDispatch(self.handle, x, y, z)
        self.work["dispatches"] += 1

    def dispatch_indirect(self, buffer: Any, offset: int) -> None:
        """Run as many work groups as three words at a byte offset of a buffer say, after a `compute_barrier`."""
        self._fn.vkCmdDispatchIndirect(self.handle, buffer.handle, offset)
        self.work["dispatches"] += 1

    def trace(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run the ray generation shader for each ray of `extent`; a compute pipeline runs work groups instead."""
        if pipeline.table is None:
            self.dispatch_over(pipeline, extent)
            return
        width, height, depth = (*extent, 1, 1)[:3]
        check_rays((width, height, depth), pipeline.table.limits.most_rays)
        self._fn.vkCmdTraceRaysKHR(self.handle, *pipeline.table.arguments, width, height, depth)
        self.work["dispatches"] += 1

    def compute_barrier(self) -> None:
        """Make later dispatches wait for earlier ones, and make the stores of those visible."""
        self._fn.vkCmdPipelineBarrier2(self.handle, _ONE_AFTER_ANOTHER)
