"""The study depth-peeling on Vulkan: the frame of renderer.py, and the set of the depths behind those of materials."""

from __future__ import annotations

from collections.abc import Sequence

from ...frames.commands import DrawGroup, SceneBinding
from ...frames.vulkan_commands import Commands
from .renderer import Peeling


class Renderer(Peeling):
    """The frame with peeled layers, on Vulkan."""

    @staticmethod
    def draw(commands: Commands, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene that also bind the set of the sources."""
        _, depths = commands.sources
        commands.draw_groups(groups, scene._replace(layers=depths))
