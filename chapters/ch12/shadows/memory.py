"""The memory of shadows on a backend: the pages, targets to draw faces to, and a buffer for each slot."""

from __future__ import annotations

from typing import Any, Protocol

from common.scene import Sampler

from ..frames.commands import Commands, Counted
from ..pipelines.description import Built
from .layout import BlockLayout
from .lists import MOST_LAYERS, ShadowLists, layers_of, target_size

NEAREST = Sampler("nearest", "nearest", None, "clamp", "clamp")

TABLES = ("draws", "batches", "meshlets", "lists", "numbers", "commands")
"""The buffers of the kernels that cull, in the order of their bindings (cull.glsl)."""


class Mapped(Protocol):
    """A buffer that the CPU writes."""

    @property
    def mapped(self) -> Any:
        """(size,) uint8."""


class ShadowMemory:
    """What frames draw shadows with; `vulkan.py` and `gl.py` create it."""

    blocks: list[Any]
    """The buffer of each slot, which the CPU writes (layout.py)."""

    def __init__(self, backend: Any, layout: BlockLayout, pages: Any) -> None:
        self._backend, self.layout, self._pages = backend, layout, pages
        self._targets: dict[int, Any] = {}
        self.most_layers = MOST_LAYERS
        """The most faces of a round on this device."""
        self._create()

    @property
    def pages(self) -> Any:
        """The image with all pages, in R32F (page_table/pages.py)."""
        return self._pages.image

    def _create(self) -> None:
        """Create blocks."""
        raise NotImplementedError

    def prepare(self, size: int) -> None:
        """Create the layers to which faces of a size are drawn, before the first frame that draws any is recorded."""
        if size not in self._targets:
            self._targets[size] = self._create_target(target_size(size), layers_of(size, self.most_layers))

    def _create_target(self, size: int, layers: int) -> Any:
        raise NotImplementedError

    # --- culling ---

    def make_lists(self, lists: ShadowLists) -> None:
        """Create the buffers of other lists; earlier ones are freed after the last frame that uses them."""
        raise NotImplementedError

    def _table(self, name: str) -> Any:
        """Return a buffer of TABLES."""
        raise NotImplementedError

    def counted(self, number: int) -> Counted:
        """Return the draw commands, with the place of their number."""
        native = self._backend.plan.native("draw-indirect-count")
        return Counted(self._table("commands"), self._table("numbers"), 4 * number, native)

    def unlimited(self, records: Any, lists: ShadowLists) -> Counted:
        """Return `records` with a number that is never reached.

        Mesa's software driver (25.0.7) takes the number of the last counted draw for later draws without one, so where
        casters are counted, the draws of the picture have a number, too (culling/memory.py).
        """
        return self.counted(lists.sizes["numbers"] // 4 - 1)._replace(records=records)

    def begin_lists(self, commands: Any) -> None:
        """Let kernels write lists and commands that earlier draws have read."""

    def bind_lists(self, commands: Any, kernel: Built) -> None:
        """Bind a kernel that culls."""
        raise NotImplementedError

    # --- recording ---

    def begin_round(self, commands: Any, size: int) -> None:
        """Make the target of a size ready to be drawn to."""

    def begin_face(self, commands: Any, size: int, layer: int, over: bool = False) -> None:
        """Begin drawing to a layer of the target: `over` what is there, or after clearing it to the far plane."""
        target = self._targets[size]
        commands.begin_rendering((target.kept if over else target.layers)[layer])

    def end_face(self, commands: Any) -> None:
        """End drawing."""

    def store(self, commands: Commands, kernel: Built, size: int, number: int) -> None:
        """Copy layers into the pages, as the copies of a round say."""
        raise NotImplementedError

    def finish(self, commands: Any) -> None:
        """Make the pages visible, and bind again what the kernel replaced."""

    def close(self) -> None:
        """Free everything."""
        raise NotImplementedError
