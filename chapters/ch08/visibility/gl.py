"""The draw of the resolve on OpenGL: a page as a block, textures in their units, and the constants."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl.resources import bind_buffer

from ..frames.backend.gl import GlBackend
from ..frames.gl_commands import PAGE_BINDING, Commands
from ..pipelines.description import Built


class Draws:
    """Makes the calls of triangles over all pixels."""

    def __init__(self, backend: GlBackend) -> None:
        self._context = backend.device

    def draw(
        self, commands: Commands, pipeline: Built, scene: Any, page: Any, textures: Any, constants: np.ndarray
    ) -> None:
        """Draw one triangle; the scene is bound for the whole frame."""
        bind_buffer(self._context, "storage", PAGE_BINDING, page[0])
        if textures:
            commands.bind_textures(textures)
        commands.push(pipeline, constants)
        commands.draw_fullscreen(pipeline)
