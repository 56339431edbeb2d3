"""The bindings of the resolve on OpenGL: a page as a block, and textures in their units."""

from __future__ import annotations

from typing import Any

from backends.gl.resources import bind_buffer

from ..frames.backend.gl import GlBackend
from ..frames.commands import SceneBinding
from ..frames.gl_commands import PAGE_BINDING, Commands
from ..pipelines.description import Built


class Bindings:
    """Binds what the resolve reads."""

    def __init__(self, backend: GlBackend) -> None:
        self._context = backend.device

    def bind(
        self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind the kernel, the targets, a page and a set of textures; the scene is bound for the whole frame."""
        commands.bind_compute(pipeline, scene)
        bind_buffer(self._context, "storage", PAGE_BINDING, page[0])
        if textures:
            commands.bind_textures(textures)
