"""The study screen-space-reflections on Vulkan: everything is in renderer.py."""

from __future__ import annotations

from .renderer import Reflecting


class Renderer(Reflecting):
    """The frame with reflections, on Vulkan."""
