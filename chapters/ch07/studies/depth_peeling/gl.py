"""The study depth-peeling on OpenGL: the frame of renderer.py, and the textures of the depths, bound one by one."""

from __future__ import annotations

from collections.abc import Sequence

from ...frames.commands import DrawGroup, SceneBinding
from ...frames.gl_commands import Commands
from .renderer import Peeling


class Renderer(Peeling):
    """The frame with peeled layers, on OpenGL."""

    API = "gl"

    @staticmethod
    def draw(commands: Commands, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene after the textures that the pass samples."""
        commands.bind_textures(commands.sources)
        commands.draw_groups(groups, scene)
