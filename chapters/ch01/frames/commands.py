"""The commands of passes, the same for both APIs; `vulkan_commands.py` and `gl_commands.py` implement them.

The methods around passes (barriers, labels, attachments) are not here: they differ too much between the APIs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from ..pipelines.description import Built, Front


class SceneBinding(NamedTuple):
    """The scene's data that draws of one slot bind, in the form of the backend's commands.

    `frame` is the data that all shaders of the scene read: a descriptor set on Vulkan; OpenGL binds it once, at the
    beginning of a frame. `geometry` contains vertices and indices.
    """

    frame: Any
    geometry: Any


class DrawGroup(NamedTuple):
    """Draws that share a pipeline, culling and textures; `textures` and `draws` are in the form of the backend."""

    pipeline: Built
    cull: bool
    front: Front
    textures: Any
    draws: Sequence[Any]


class Commands(Protocol):
    """Records draws, and counts them in `work`."""

    work: dict[str, int]
    sources: Any
    """The binding of the images that the current pass reads from other passes; None if it reads none."""

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw one triangle over the whole target; its shaders read the sources, and `scene` if there is one."""

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order."""
