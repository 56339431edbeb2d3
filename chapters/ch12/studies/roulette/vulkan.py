"""The study roulette on Vulkan."""

from __future__ import annotations

from ..of_paths import PathStudy
from . import Settings


class Renderer(PathStudy):
    """A room with long paths, on Vulkan."""

    KIND = Settings
