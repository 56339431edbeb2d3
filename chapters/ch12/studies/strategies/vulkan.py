"""The study strategies on Vulkan."""

from __future__ import annotations

from ..of_paths import PathStudy
from . import Settings


class Renderer(PathStudy):
    """Plates and lamps, on Vulkan."""

    KIND = Settings
