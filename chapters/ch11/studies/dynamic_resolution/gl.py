"""The study dynamic-resolution on OpenGL: the frame of renderer.py, with OpenGL below it."""

from __future__ import annotations

from .renderer import Scaled


class Renderer(Scaled):
    """The frame at eight scales, on OpenGL."""

    API = "gl"
