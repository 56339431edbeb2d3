"""The study tessellation on Vulkan: a pipeline of five stages that draws patches, and a query around the draw."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.driver import features as vf
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ..drawing_vulkan import Drawing, Drawn
from . import STUDY, UNIFORM_BYTES, Settings, defines, record_bytes, shaders, uniforms, work_of

STORED = (vk.VK_PIPELINE_STAGE_2_GEOMETRY_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
CLEARED = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
READ_AND_WRITE = STORED[1] | vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT
BITS = {
    "tessellates": ("tessellationShader", "cuts triangles on the GPU", ""),
    "edges": ("geometryShader", "finds edges in a geometry shader", "; try --set edges=off"),
    "recorded": ("vertexPipelineStoresAndAtomics", "records triangles", "; try --set recorded=off"),
}


class Renderer(Drawing):
    """A terrain of patches."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True
    moves = False

    def create(self) -> None:
        """Make the pipeline, the uniforms, and the queries."""
        device, settings = self.device, self.settings
        wanted = ["tessellates"] + ["edges"] * settings.edges + ["recorded"] * settings.recorded
        for bit, what, hint in map(BITS.__getitem__, wanted):
            missing = device.physical.lacks(vf.Requirement(bits=((vf.CORE, bit),)))
            if missing:
                raise UnsupportedError(f"The study tessellation {what}: {missing}{hint}.")
        drawn = Drawn(shaders(settings), defines(settings), color="rgba8", name="terrain", patch=3)
        self._terrain = self.build(drawn)
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "frame")
        self._record = (
            self.empty(record_bytes(settings), ["storage"], "triangles") if settings.recorded else None
        )
        more = {1: self._record} if self._record else {}
        self._sets = [self.set_of(self._terrain, {0: frame, **more}, frame.name) for frame in self._uniforms]
        self._before_clear = barriers(memory=(*STORED, *CLEARED))
        self._after_clear = barriers(memory=(*CLEARED, STORED[0], READ_AND_WRITE))
        self._queries = None
        if device.has("pipeline-statistics"):
            info = vk.new(
                "VkQueryPoolCreateInfo",
                queryType=vk.VK_QUERY_TYPE_PIPELINE_STATISTICS,
                queryCount=SLOTS,
                pipelineStatistics=vk.VK_QUERY_PIPELINE_STATISTIC_CLIPPING_INVOCATIONS_BIT,
            )
            pool = device.create("vkCreateQueryPool", info, "primitives")
            self._queries = self.keep(pool, lambda pool: device.destroy("VkQueryPool", pool))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the patches, and let the GPU count the triangles that reach clipping."""
        fn, slot = self.device.fn, commands.slot.index
        self.work = work = work_of(self.settings, view)
        numbers = uniforms(self.settings, view, self.size[0] / self.size[1])
        self._uniforms[slot].view(np.float32)[:] = numbers
        if self._record:
            commands.barrier(self._before_clear)
            commands.begin_label("clear")
            fn.vkCmdFillBuffer(commands.handle, self._record.handle, 0, 16, 0)
            commands.end_label()
            commands.barrier(self._after_clear)
        if self._queries:
            fn.vkCmdResetQueryPool(commands.handle, self._queries, slot, 1)
            fn.vkCmdBeginQuery(commands.handle, self._queries, slot, 0)
        commands.begin_label("terrain")
        self.begin(commands)
        commands.bind_pipeline(self._terrain, cull=True)
        commands.bind_set(self._terrain, 0, self._sets[slot])
        fn.vkCmdDraw(commands.handle, 3 * work.patches, 1, 0, 0)
        self.end(commands)
        commands.end_label()
        if self._queries:
            fn.vkCmdEndQuery(commands.handle, self._queries, slot)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how many triangles the GPU made in the slot's frame, after a wait for it."""
        if not self._queries:
            return {}
        self._frames.wait(slot)
        count = np.zeros(1, np.uint64)
        flags = vk.VK_QUERY_RESULT_64_BIT | vk.VK_QUERY_RESULT_WAIT_BIT
        place = (self.device.handle, self._queries, slot.index, 1)
        code = self.device.fn.vkGetQueryPoolResults(*place, 8, vk.ffi.from_buffer(count), 8, flags)
        vk.check(code, "vkGetQueryPoolResults")
        return {"generated": int(count[0])}

    def triangles(self) -> np.ndarray:
        """Return the small triangles of the last frame, (N, 3, 4) float32: corners, and the number of the patch."""
        assert self._record is not None, "open the study with recorded=True"
        words = self.download(self._record, STORED).view(np.uint32)
        return words[4 : 4 + 12 * int(words[0])].view(np.float32).reshape(-1, 3, 4)
