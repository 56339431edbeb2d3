"""Turns lists of draws into OpenGL calls, and counts them; frames/vulkan_commands.py records the same draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import bind_buffer
from backends.gl.targets import Framebuffer, begin

from ..pipelines.description import Built, Front
from ..pipelines.gl import Pipelines
from ..scene.draw_lists import COMMAND
from .commands import Counted, DrawGroup, SceneBinding
from .gl import FrameSlot
from .gl_dispatches import Dispatches

PAGE_BINDING = 4
"""The storage block of a page of geometry (vertices.glsl)."""

PREVIOUS_BINDING = 5
"""The storage block of the page as the frame before drew it."""

Textures = tuple[tuple[int, int, int], ...]
"""The textures that a material binds: (unit, view, sampler) of each."""


@dataclass(frozen=True)
class Rendering:
    """A framebuffer, and the clear values of its attachments; None keeps the content."""

    target: Framebuffer
    clear_colors: Sequence[Sequence[float] | None] = ()
    clear_depth: float | None = None


class Commands(Dispatches):
    """Makes the calls of one frame, and counts its draws."""

    def __init__(self, context: Context, pipelines: Pipelines, multi_draw: bool) -> None:
        self._context, self._pipelines, self._multi_draw = context, pipelines, multi_draw
        self.slot: FrameSlot
        self.work: dict[str, int] = {}

    def begin(self, slot: FrameSlot) -> None:
        """Start a frame in `slot`, with all counters at zero."""
        self.slot = slot
        self.work = {"draws": 0, "draw_calls": 0, "triangles": 0, "pipeline_binds": 0, "descriptor_binds": 0}
        self.work["dispatches"] = 0

    # --- around passes: called by the renderer ---

    def begin_rendering(self, rendering: Rendering) -> None:
        """Begin drawing to a framebuffer, over its whole size."""
        begin(self._context, rendering.target, rendering.clear_colors, rendering.clear_depth)

    # --- within passes: called by the passes ---

    def bind_pipeline(self, pipeline: Built, cull: bool = False, front: Front = "counter_clockwise") -> None:
        """Bind a pipeline and set its state; `cull` discards back faces."""
        self._pipelines.bind(pipeline, cull, front)
        self.work["pipeline_binds"] += 1

    def bind_textures(self, textures: Textures) -> None:
        """Bind textures to their units."""
        fn = self._context.fn
        for unit, view, sampler in textures:
            fn.glBindTextureUnit(unit, view)
            fn.glBindSampler(unit, sampler)
        self.work["descriptor_binds"] += 1

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw the one triangle of `fullscreen.vert`; the scene's data is bound at the beginning of the frame."""
        self.bind_pipeline(pipeline)
        if self.sources:
            self.bind_textures(self.sources)
        self._context.fn.glBindVertexArray(self._pipelines.no_vertices)
        self._context.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        self.work["draws"] += 1
        self.work["draw_calls"] += 1
        self.work["triangles"] += 1

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order; without multi-draw, with one call a record."""
        context, fn = self._context, self._context.fn
        fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, scene.records.handle)
        several, size = self._multi_draw, COMMAND.itemsize
        bound: tuple[Any, bool, Front] | None = None
        textures: Textures = ()
        vertex_array = 0
        for group in groups:
            batch, state = group.batch, (group.pipeline, group.cull, group.front)
            if state != bound:
                self.bind_pipeline(*state)
                bound = state
                if scene.pushed is not None:
                    self.push(group.pipeline, scene.pushed)
            page, indices = group.page
            if indices != vertex_array:
                vertex_array = indices
                fn.glBindVertexArray(vertex_array)
                bind_buffer(context, "storage", PAGE_BINDING, page)
                if group.previous is not None:
                    bind_buffer(context, "storage", PREVIOUS_BINDING, group.previous)
            if group.textures and group.textures is not textures:
                self.bind_textures(group.textures)
                textures = group.textures
            if group.counted is not None:
                self._draw_counted(group.counted, batch.first, batch.count)
                fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, scene.records.handle)
                continue
            count, calls = (batch.count, 1) if several else (1, batch.count)
            for call in range(calls):
                first = gl.ffi.cast("void *", (batch.first + call) * size)
                fn.glMultiDrawElementsIndirect(gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT, first, count, size)
            self.work["draw_calls"] += calls
            self.work["draws"] += batch.count
            self.work["triangles"] += batch.triangles

    def _draw_counted(self, counted: Counted, first: int, most: int) -> None:
        """Draw commands whose number is on the GPU."""
        fn, size = self._context.fn, COMMAND.itemsize
        fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, counted.records.handle)
        kind = (gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT)
        if counted.is_native:
            fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, counted.numbers.handle)
            start = gl.ffi.cast("void *", first * size)
            fn.glMultiDrawElementsIndirectCountARB(*kind, start, counted.offset, most, size)
            # Mesa reads the number from a bound buffer in calls that have none, too, as of 25.0.
            fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, 0)
            self.work["draw_calls"] += 1
            return
        at_once = most if self._multi_draw else 1
        for start in range(first, first + most, max(1, at_once)):
            fn.glMultiDrawElementsIndirect(*kind, gl.ffi.cast("void *", start * size), at_once, size)
            self.work["draw_calls"] += 1
