"""The frame of renderer.py on OpenGL: the same passes in the same order, by `frames/gl_backend.py`."""

from __future__ import annotations

from . import renderer


class Renderer(renderer.Renderer):
    """The chapter on OpenGL."""

    API = "gl"
