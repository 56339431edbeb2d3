"""The renderer on OpenGL: the frame of renderer.py, with the backend `frames/backend/gl.py`."""

from __future__ import annotations

from . import renderer


class Renderer(renderer.Renderer):
    """The OpenGL renderer of the chapter."""

    API = "gl"
