"""The study strategies on OpenGL."""

from __future__ import annotations

from ..of_paths import PathStudy
from . import Settings


class Renderer(PathStudy):
    """Plates and lamps, on OpenGL."""

    API, KIND = "gl", Settings
