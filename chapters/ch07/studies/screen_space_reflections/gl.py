"""The study screen-space-reflections on OpenGL: the frame of renderer.py, with OpenGL below it."""

from __future__ import annotations

from .renderer import Reflecting


class Renderer(Reflecting):
    """The frame with reflections, on OpenGL."""

    API = "gl"
