"""What a pass records, the same for both APIs; `vulkan_commands.py` and `gl_commands.py` carry it out.

The methods around passes (barriers, labels, attachments) differ too much to be one: they are each backend's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..pipelines.description import Built, Front
from ..scene.draw_lists import Batch


class SceneBinding(NamedTuple):
    """What draws of one slot bind of the scene, as the backend's commands take it.

    `frame` is what all shaders of the scene read: a descriptor set on Vulkan; OpenGL binds it once at the beginning of
    a frame. `records` is the buffer with the draws of the slot; `computed` is the set for shaders that compute.
    """

    frame: Any
    records: Any
    computed: Any = None


@dataclass(frozen=True)
class DrawGroup:
    """Draws of the slot's list of records that share pipeline, culling, page and textures.

    `page` and `textures` are as the backend's data gave them: what binds a page of geometry, and a set of textures.
    """

    batch: Batch
    pipeline: Built
    cull: bool
    front: Front
    page: Any
    textures: Any


class Commands(Protocol):
    """Records draws and dispatches, and counts them in `work`."""

    work: dict[str, int]
    sources: Any
    """What the pass that is recorded reads of other passes, bound; None where it reads nothing."""
    extent: tuple[int, int]
    """The pixels of what the pass that is recorded writes."""

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw one triangle over the whole target; its shaders read the sources, and what is given of the scene."""

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order."""

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Bind what the next dispatches run and read: a pipeline, the sources, and what is given of the scene."""

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants to what a recording fixes: sizes, numbers, levels."""

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run work groups of the pipeline that is bound."""

    def dispatch_over(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run as many groups as cover `extent`, 1 to 3 numbers of invocations: pixels, or elements of an array."""

    def compute_barrier(self) -> None:
        """Let the dispatches behind this wait for those before it, and see what they stored."""
