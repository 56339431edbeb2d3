"""Recording: a thin, fast layer over one command buffer, with the loop that turns lists of draws into commands.

Every struct that a frame needs is built once and reused. The GPU reads the arguments of draws from a buffer
(`VkDrawIndexedIndirectCommand`), so recording costs one call per state and nothing per object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer, Image

from ..pipelines.description import Built, Front
from ..scene.draw_lists import COMMAND
from .commands import Counted, DrawGroup, MeshDraw, SceneBinding
from .vulkan import FrameSlot
from .vulkan_dispatches import Dispatches

_GRAPHICS = vk.VK_PIPELINE_BIND_POINT_GRAPHICS
_FRONT_FACES = {
    "counter_clockwise": vk.VK_FRONT_FACE_COUNTER_CLOCKWISE,
    "clockwise": vk.VK_FRONT_FACE_CLOCKWISE,
}


TABLES = 3
"""The number of the set that task and mesh shaders read (meshlets/tables.glsl)."""


class Rendering:
    """A VkRenderingInfo with its attachments, built once per size of the targets."""

    def __init__(
        self,
        size: tuple[int, int],
        color: Image | None,
        depth: Image | None,
        clear_color: Sequence[float] | Sequence[int] | None = None,
        clear_depth: float | None = None,
    ) -> None:
        self.size = size
        self.images: tuple[Image | None, ...] = (color, depth)
        attachments = None
        if color is not None:
            value: dict[str, Any] = {}
            if clear_color is not None:
                kind = "uint32" if color.format.endswith("ui") else "float32"
                value = {"color": {kind: list(clear_color)}}
            attachments = [self._attachment(color, vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, value)]
        depth_attachment = None
        if depth is not None:
            value = {} if clear_depth is None else {"depthStencil": {"depth": clear_depth}}
            depth_attachment = self._attachment(depth, vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL, value)
        self.info = vk.new(
            "VkRenderingInfo",
            renderArea={"extent": {"width": size[0], "height": size[1]}},
            layerCount=1,
            pColorAttachments=attachments,
            pDepthAttachment=depth_attachment,
        )

    @staticmethod
    def _attachment(image: Image, layout: int, clear: dict[str, Any]) -> dict[str, Any]:
        return {
            "imageView": image.view,
            "imageLayout": layout,
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR if clear else vk.VK_ATTACHMENT_LOAD_OP_LOAD,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
            "clearValue": clear,
        }


class Commands(Dispatches):
    """Records into the command buffer of one frame slot, and counts what it records."""

    def __init__(self, device: Device, multi_draw: bool = True) -> None:
        self._fn = device.fn
        self._labels = device.instance.has_debug_utils
        self._label_infos: dict[str, Any] = {}
        self._states: dict[tuple[int, int], tuple[Any, Any]] = {}
        self.handle: Any = None
        self.slot: FrameSlot
        self.work: dict[str, int] = {}
        self._multi_draw = multi_draw
        self._most = int(device.limits.maxDrawIndirectCount)

    def begin(self, slot: FrameSlot) -> None:
        """Start recording into the commands of `slot`, with all counters at zero."""
        self.slot = slot
        self.handle = slot.commands
        self.work = {"draws": 0, "draw_calls": 0, "triangles": 0, "pipeline_binds": 0, "descriptor_binds": 0}
        self.work["dispatches"] = 0

    def close(self) -> None:
        """Free nothing: the slots own the command buffers."""

    # --- around passes: called by the renderer ---

    def barrier(self, dependency: Any) -> None:
        """Record a VkDependencyInfo made by `backends.vulkan.barriers.barriers`."""
        self._fn.vkCmdPipelineBarrier2(self.handle, dependency)

    def begin_label(self, name: str) -> None:
        """Open a label: validation messages, captures and traces show it as the name of the pass."""
        if self._labels:
            info = self._label_infos.get(name)
            if info is None:
                info = self._label_infos[name] = vk.new("VkDebugUtilsLabelEXT", pLabelName=name)
            self._fn.vkCmdBeginDebugUtilsLabelEXT(self.handle, info)

    def end_label(self) -> None:
        """Close the label that was opened last."""
        if self._labels:
            self._fn.vkCmdEndDebugUtilsLabelEXT(self.handle)

    def begin_rendering(self, rendering: Rendering) -> None:
        """Begin drawing to the attachments of `rendering`, over their whole size."""
        self._fn.vkCmdBeginRendering(self.handle, rendering.info)
        self.set_area(rendering.size)

    def set_area(self, size: tuple[int, int]) -> None:
        """Set viewport and scissor to the whole of attachments of this size."""
        viewport, scissor = self._viewport(size)
        self._fn.vkCmdSetViewport(self.handle, 0, 1, viewport)
        self._fn.vkCmdSetScissor(self.handle, 0, 1, scissor)

    def end_rendering(self) -> None:
        """End drawing."""
        self._fn.vkCmdEndRendering(self.handle)

    def _viewport(self, size: tuple[int, int]) -> tuple[Any, Any]:
        if size not in self._states:
            viewport = vk.new("VkViewport", width=float(size[0]), height=float(size[1]), maxDepth=1.0)
            self._states[size] = viewport, vk.new("VkRect2D", extent={"width": size[0], "height": size[1]})
        return self._states[size]

    # --- within passes: called by the passes ---

    def bind_pipeline(self, pipeline: Built, cull: bool = False, front: Front = "counter_clockwise") -> None:
        """Bind a pipeline and set its dynamic state; `cull` discards back faces."""
        self._fn.vkCmdBindPipeline(self.handle, _GRAPHICS, pipeline.handle)
        self._fn.vkCmdSetCullMode(self.handle, vk.VK_CULL_MODE_BACK_BIT if cull else vk.VK_CULL_MODE_NONE)
        self._fn.vkCmdSetFrontFace(self.handle, _FRONT_FACES[front])
        self.work["pipeline_binds"] += 1

    def bind_set(self, pipeline: Built, number: int, descriptor_set: Any) -> None:
        """Bind an array of one descriptor set as set `number`."""
        fn = self._fn
        fn.vkCmdBindDescriptorSets(
            self.handle, _GRAPHICS, pipeline.layout, number, 1, descriptor_set, 0, vk.NULL
        )
        self.work["descriptor_binds"] += 1

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw the one triangle of `fullscreen.vert`, with the sets of the scene, if given, and of the sources."""
        self.bind_pipeline(pipeline)
        if scene is not None and pipeline.sets[0] is not None:
            self.bind_set(pipeline, 0, scene.frame)
        if self.sources is not None:
            self.bind_set(pipeline, *self.sources)
        self.draw_triangle()

    def draw_triangle(self) -> None:
        """Draw three vertices with the bound pipeline and sets."""
        self._fn.vkCmdDraw(self.handle, 3, 1, 0, 0)
        self.work["draws"] += 1
        self.work["draw_calls"] += 1
        self.work["triangles"] += 1

    def draw_by(self, record: Callable[[Commands], None]) -> None:
        """Record draws that are none of the above."""
        record(self)

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record all draws of `groups` in order, with the frame's set as set 0.

        One call draws a whole group; without multi-draw the CPU reads the records and makes a call for each.
        """
        fn, handle = self._fn, self.handle
        bound: tuple[Any, bool, Front] | None = None
        layout: Any = None
        sets: tuple[Any, ...] = (None, None, None)
        index_buffer: Any = None
        for group in groups:
            batch, pipeline = group.batch, group.pipeline
            state = (pipeline.handle, group.cull, group.front)
            if state != bound:
                self.bind_pipeline(pipeline, group.cull, group.front)
                bound = state
            if pipeline.layout != layout:
                # Sets stay bound while the layout stays the same.
                layout, sets = pipeline.layout, (None, None, None)
                self.bind_set(pipeline, 0, scene.frame)
                if scene.pushed is not None:
                    self.push(pipeline, scene.pushed)
            page_set, indices = group.page
            if group.meshlets is not None:
                indices = index_buffer  # mesh shaders read no index buffer
            wanted = (page_set, group.textures, scene.layers)
            for number, (before, now) in enumerate(zip(sets, wanted, strict=True), 1):
                if now is not None and now is not before:
                    self.bind_set(pipeline, number, now)
            sets = wanted
            if indices != index_buffer:
                index_buffer = indices
                fn.vkCmdBindIndexBuffer(handle, index_buffer, 0, vk.VK_INDEX_TYPE_UINT32)
            if group.meshlets is not None:
                self._draw_meshlets(pipeline, group.meshlets)
                continue
            counted = group.counted or scene.counted
            if counted is not None:
                self._draw_counted(counted, batch.first, batch.count)
            else:
                self._draw(scene.records, batch.first, batch.count)
            if group.counted is not None:
                continue
            self.work["draws"] += batch.count
            self.work["triangles"] += batch.triangles

    def _draw_counted(self, counted: Counted, first: int, most: int) -> None:
        fn, size = self._fn, COMMAND.itemsize
        records, numbers = counted.records.handle, counted.numbers.handle
        if counted.is_native:
            offset, most = counted.offset, min(most, self._most)
            fn.vkCmdDrawIndexedIndirectCount(self.handle, records, first * size, numbers, offset, most, size)
            self.work["draw_calls"] += 1
            return
        at_once = self._most if self._multi_draw else 1
        for start in range(first, first + most, at_once):
            some = min(at_once, first + most - start)
            fn.vkCmdDrawIndexedIndirect(self.handle, records, start * size, some, size)
            self.work["draw_calls"] += 1

    def _draw_meshlets(self, pipeline: Built, draw: MeshDraw) -> None:
        self.bind_set(pipeline, TABLES, draw.tables)
        self.push(pipeline, draw.constants)
        self._fn.vkCmdDrawMeshTasksIndirectEXT(self.handle, draw.arguments.handle, draw.offset, 1, 16)
        self.work["draw_calls"] += 1

    def _draw(self, records: Buffer, first: int, count: int) -> None:
        if not self._multi_draw:
            draw, handle = self._fn.vkCmdDrawIndexed, self.handle
            for record in records.view(COMMAND)[first : first + count].tolist():
                draw(handle, *record)
            self.work["draw_calls"] += count
            return
        size, end = COMMAND.itemsize, first + count
        for start in range(first, end, self._most):
            some = min(self._most, end - start)
            self._fn.vkCmdDrawIndexedIndirect(self.handle, records.handle, start * size, some, size)
            self.work["draw_calls"] += 1
