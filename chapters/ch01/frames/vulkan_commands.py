"""Recording: a thin, fast layer over one command buffer, with the loop that turns lists of draws into commands.

Every struct that a frame needs is built once and reused. A draw is then three raw calls (bind, push, draw) of half a
microsecond each. The same calls through the wrappers of the `vulkan` package take five times as long.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Image

from ..pipelines.description import Built, Front
from ..scene.packing import PUSH_SIZE
from .commands import DrawGroup, SceneBinding
from .vulkan import FrameSlot

_GRAPHICS = vk.VK_PIPELINE_BIND_POINT_GRAPHICS
_STAGES = vk.VK_SHADER_STAGE_VERTEX_BIT | vk.VK_SHADER_STAGE_FRAGMENT_BIT
_FRONT_FACES = {
    "counter_clockwise": vk.VK_FRONT_FACE_COUNTER_CLOCKWISE,
    "clockwise": vk.VK_FRONT_FACE_CLOCKWISE,
}


class Draw(NamedTuple):
    """One draw of a mesh: `push` points to its push constants, the rest are arguments of vkCmdDrawIndexed."""

    push: Any
    index_count: int
    first_index: int
    first_vertex: int


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


class Commands:
    """Records into the command buffer of one frame slot, and counts what it records."""

    def __init__(self, device: Device) -> None:
        self._fn = device.fn
        self._labels = device.instance.has_debug_utils
        self._label_infos: dict[str, Any] = {}
        self._states: dict[tuple[int, int], tuple[Any, Any]] = {}
        self.handle: Any = None
        self.sources: Any = None
        self.slot: FrameSlot
        self.work: dict[str, int] = {}

    def begin(self, slot: FrameSlot) -> None:
        """Start recording into the commands of `slot`, with all counters at zero."""
        self.slot = slot
        self.handle = slot.commands
        self.work = {"draws": 0, "triangles": 0, "pipeline_binds": 0, "descriptor_binds": 0}

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
        viewport, scissor = self._viewport(rendering.size)
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

    def bind_geometry(
        self, streams: Sequence[tuple[int, Any, Any]], index_buffer: Any, index_offset: int
    ) -> None:
        """Bind vertex streams (binding, array of one buffer, array of its offset) and the 32-bit index buffer."""
        for binding, buffers, offsets in streams:
            self._fn.vkCmdBindVertexBuffers(self.handle, binding, 1, buffers, offsets)
        self._fn.vkCmdBindIndexBuffer(self.handle, index_buffer, index_offset, vk.VK_INDEX_TYPE_UINT32)

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw the one triangle of `fullscreen.vert`; set 0 is the set of the scene if given, or of the sources."""
        self.bind_pipeline(pipeline)
        self.bind_set(pipeline, 0, scene.frame if scene else self.sources)
        self.draw_triangle()

    def draw_triangle(self) -> None:
        """Draw three vertices with the bound pipeline and sets."""
        self._fn.vkCmdDraw(self.handle, 3, 1, 0, 0)
        self.work["draws"] += 1
        self.work["triangles"] += 1

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record all draws of `groups` in order, with the frame's set as set 0."""
        self.bind_geometry(*scene.geometry)
        # Looked up once: the loop runs for every object of the scene in every frame.
        bind, push, draw = (
            self._fn.vkCmdBindDescriptorSets,
            self._fn.vkCmdPushConstants,
            self._fn.vkCmdDrawIndexed,
        )
        handle, null = self.handle, vk.NULL
        bound: tuple[Any, bool, str] | None = None
        layout: Any = None
        texture_set: Any = None
        count = triangles = binds = 0
        for group in groups:
            pipeline, cull, front, textures, draws = group
            state = (pipeline.handle, cull, front)
            if state != bound:
                self.bind_pipeline(pipeline, cull, front)
                bound = state
            if pipeline.layout != layout:
                # Sets stay bound while the layout stays the same.
                layout, texture_set = pipeline.layout, None
                self.bind_set(pipeline, 0, scene.frame)
            if textures is not None and textures is not texture_set:
                bind(handle, _GRAPHICS, layout, 1, 1, textures, 0, null)
                texture_set = textures
                binds += 1
            for constants, index_count, first_index, first_vertex in draws:
                push(handle, layout, _STAGES, 0, PUSH_SIZE, constants)
                draw(handle, index_count, 1, first_index, first_vertex, 0)
                triangles += index_count
            count += len(draws)
        self.work["draws"] += count
        self.work["triangles"] += triangles // 3
        self.work["descriptor_binds"] += binds
