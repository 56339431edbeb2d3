"""The commands of passes, the same for both APIs; `vulkan_commands.py` and `gl_commands.py` implement them.

The methods around passes (barriers, labels, attachments) are not here: they differ too much between the APIs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..pipelines.description import Built, Front
from ..scene.draw_lists import Batch


class Counted(NamedTuple):
    """Draw commands, a buffer with their number, and its byte offset; unless `is_native`, further ones draw nothing."""

    records: Any
    numbers: Any
    offset: int
    is_native: bool


class SceneBinding(NamedTuple):
    """The scene's data that draws of one slot bind, in the form of the backend's commands.

    `frame` is the data that all shaders of the scene read: a descriptor set on Vulkan; OpenGL binds it once, at the
    beginning of a frame. `records` is the buffer of the slot's draw records.
    """

    frame: Any
    records: Any
    counted: Counted | None = None
    """A number of records that is never reached, where other draws of the frame have their number on the GPU."""
    layers: Any = None
    """The set behind those of the scene that draws of layers bind, if the backend has sets."""
    pushed: Any = None
    """The push constants of all draws, if they have any."""


class MeshDraw(NamedTuple):
    """One draw of mesh shaders: its descriptor set, its constants, and the buffer and offset of its arguments."""

    tables: Any
    constants: np.ndarray
    arguments: Any
    offset: int


@dataclass(frozen=True)
class DrawGroup:
    """Draws in the slot's list of records that share pipeline, culling, page and textures.

    `page` and `textures` are the bindings of a page of geometry and of a set of textures, in the form of the backend.
    """

    batch: Batch
    pipeline: Built
    cull: bool
    front: Front
    page: Any
    textures: Any
    counted: Counted | None = None
    """The commands that culling has left; `batch` then has their first place, and how many there can be."""
    with_meshlets: Sequence[Built | None] = (None, None)
    """The pipelines that draw the meshlets of each phase, if mesh shaders do."""
    meshlets: MeshDraw | None = None
    """The mesh shaders of a batch, in place of draw commands."""
    previous: Any = None
    """The page of geometry as the frame before drew it, if it is bound; on Vulkan the set of `page` has it, too."""


class Commands(Protocol):
    """Records draws and dispatches, and counts them in `work`."""

    work: dict[str, int]
    sources: Any
    """The binding of the images that the current pass reads from other passes; None if it reads none."""
    extent: tuple[int, int]
    """The size in pixels of the image that the current pass writes."""

    def draw_fullscreen(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Draw one triangle over the whole target; its shaders read the sources, and `scene` if there is one."""

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order."""

    def bind_compute(self, pipeline: Built, scene: SceneBinding | None = None) -> None:
        """Bind the pipeline of the next dispatches, the sources, and `scene` if there is one."""

    def push(self, pipeline: Built, data: np.ndarray) -> None:
        """Set the push constants, to values that are fixed in a recording: sizes, counts, levels."""

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run x * y * z work groups of the bound pipeline."""

    def dispatch_indirect(self, buffer: Any, offset: int) -> None:
        """Run as many work groups as three words at a byte offset of a buffer say, after a `compute_barrier`."""

    def dispatch_over(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run the work groups that cover `extent`, 1 to 3 numbers of invocations: pixels, or elements of an array."""

    def trace(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run a ray pass over `extent`, 1 to 3 numbers of rays: by work groups, unless the pipeline is one of rays."""

    def compute_barrier(self) -> None:
        """Make later dispatches wait for earlier ones, and make the stores of those visible."""
