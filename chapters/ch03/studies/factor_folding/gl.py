"""The study factor-folding on OpenGL: the chapter's renderer on a scene whose materials have no factors."""

from __future__ import annotations

from typing import Any

from common.scene import Scene

from ...gl_renderer import Renderer as ChapterRenderer
from .folding import folded


class Renderer(ChapterRenderer):
    """Draws what the chapter draws, from textures alone."""

    def __init__(self, scene: Scene, *arguments: Any, **more: Any) -> None:
        super().__init__(folded(scene), *arguments, **more)
