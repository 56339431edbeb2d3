"""Turns lists of draws into OpenGL calls, and counts them; frames/vulkan_commands.py records the same draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from backends.gl import api as gl
from backends.gl.context import PUSH_BINDING, Context
from backends.gl.targets import Framebuffer, begin

from ..pipelines.description import Built, Front
from ..pipelines.gl import Pipelines
from .commands import DrawGroup, SceneBinding
from .gl import FrameSlot


class Draw(NamedTuple):
    """One draw of a mesh: the byte offset of its push constants, its indices, its first vertex."""

    push: int
    index_count: int
    indices: Any  # byte offset of its first index, as a pointer
    first_vertex: int


Textures = tuple[tuple[int, int, int], ...]
"""The textures that a material binds: (unit, view, sampler) of each."""


@dataclass(frozen=True)
class Rendering:
    """A framebuffer, and the clear values of its attachments; None keeps the content."""

    target: Framebuffer
    clear_color: Sequence[float] | Sequence[int] | None = None
    clear_depth: float | None = None


class Commands:
    """Makes the calls of one frame, and counts its draws."""

    def __init__(self, context: Context, pipelines: Pipelines, push_buffer: int, push_size: int) -> None:
        self._context, self._pipelines = context, pipelines
        self._push_buffer, self._push_size = push_buffer, push_size
        self.sources: Textures | None = None
        self.slot: FrameSlot
        self.work: dict[str, int] = {}

    def begin(self, slot: FrameSlot) -> None:
        """Start a frame in `slot`, with all counters at zero."""
        self.slot = slot
        self.work = {"draws": 0, "triangles": 0, "pipeline_binds": 0, "descriptor_binds": 0}

    # --- around passes: called by the renderer ---

    def begin_rendering(self, rendering: Rendering) -> None:
        """Begin drawing to a framebuffer, over its whole size."""
        begin(self._context, rendering.target, (rendering.clear_color,), rendering.clear_depth)

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
        self.work["triangles"] += 1

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order."""
        fn = self._context.fn
        fn.glBindVertexArray(scene.geometry)
        # Looked up once: the loop runs for every object of the scene in every frame.
        bind, draw = fn.glBindBufferRange, fn.glDrawElementsBaseVertex
        uniform, buffer, size = gl.GL_UNIFORM_BUFFER, self._push_buffer, self._push_size
        triangles_of, unsigned = gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT
        bound: tuple[Any, bool, Front] | None = None
        textures: Textures = ()
        count = triangles = 0
        for group in groups:
            state = (group.pipeline, group.cull, group.front)
            if state != bound:
                self.bind_pipeline(*state)
                bound = state
            if group.textures and group.textures is not textures:
                self.bind_textures(group.textures)
                textures = group.textures
            for push, index_count, indices, first_vertex in group.draws:
                bind(uniform, PUSH_BINDING, buffer, push, size)
                draw(triangles_of, index_count, unsigned, indices, first_vertex)
                triangles += index_count
            count += len(group.draws)
        self.work["draws"] += count
        self.work["triangles"] += triangles // 3
