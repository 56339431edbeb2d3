"""The memory of shadows on a backend: the pages, targets to draw faces to, and a buffer for each slot."""

from __future__ import annotations

from typing import Any, Protocol

from ..frames.commands import Commands
from ..pipelines.description import Built
from .layout import TILE, BlockLayout

TARGET_TEXELS = 1 << 23
"""Texels of the layers of a target together: 32 MiB of depth, or one layer if that has more."""

MOST_LAYERS = 64


def layers_of(size: int) -> int:
    """Return how many faces of a size are drawn before they are copied into their pages."""
    return min(MOST_LAYERS, max(1, TARGET_TEXELS // (size * size)))


class Mapped(Protocol):
    """A buffer that the CPU writes."""

    @property
    def mapped(self) -> Any:
        """(size,) uint8."""


class ShadowMemory:
    """What frames draw shadows with; `vulkan.py` and `gl.py` create it."""

    blocks: list[Any]
    """The buffer of each slot, which the CPU writes (layout.py)."""

    pages: Any
    """The image with all pages, in R32F."""

    def __init__(self, backend: Any, layout: BlockLayout, tiles: tuple[int, int]) -> None:
        self._backend, self.layout, self.tiles = backend, layout, tiles
        self._targets: dict[int, Any] = {}
        self._create((tiles[0] * TILE, tiles[1] * TILE))

    def _create(self, size: tuple[int, int]) -> None:
        """Create blocks and pages."""
        raise NotImplementedError

    def prepare(self, size: int) -> None:
        """Create the layers to which faces of a size are drawn, before the first frame that draws any is recorded."""
        if size not in self._targets:
            self._targets[size] = self._create_target(size, layers_of(size))

    def _create_target(self, size: int, layers: int) -> Any:
        raise NotImplementedError

    # --- recording ---

    def begin_round(self, commands: Any, size: int) -> None:
        """Make the target of a size ready to be drawn to."""

    def begin_face(self, commands: Any, size: int, layer: int) -> None:
        """Begin drawing to a layer of the target, after clearing it to the far plane."""
        raise NotImplementedError

    def end_face(self, commands: Any) -> None:
        """End drawing."""

    def store(self, commands: Commands, kernel: Built, size: int, first: int, count: int) -> None:
        """Copy layers into the pages: faces `first` to `first + count` of those that the frame draws."""
        raise NotImplementedError

    def finish(self, commands: Any) -> None:
        """Make the pages visible, and bind again what the kernel replaced."""

    def close(self) -> None:
        """Free everything."""
        raise NotImplementedError
