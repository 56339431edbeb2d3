"""The depth pyramid: for each level, the farthest depth below each of its texels, all levels in one storage buffer.

Level k, from 1 on, has ceil(width / 2^k) x ceil(height / 2^k) texels, down to 1x1. A texel is the minimum of the depth
(reversed Z: the farthest) over those pixels of its square of 2^k x 2^k that are inside the picture. Sizes that are
rounded down, as those of mip chains are, would leave the last column of an odd level without a texel: something visible
there alone would count as hidden. The levels are in a buffer, since no image has such sizes in its chain of mip levels.

`pyramid.glsl` has the same layout, `pyramid.comp` fills it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TILE = 64
"""Texels along an edge of what a work group reduces to one texel."""
STEP = 6
"""Levels that a dispatch adds: 2^6 = 64."""


@dataclass(frozen=True)
class Level:
    """The place of a level in the buffer: its texels are row by row from word `first` on."""

    width: int
    height: int
    first: int


@dataclass(frozen=True)
class Reduction:
    """A dispatch of `groups` work groups, which reads level `source` and writes the next levels, at most six."""

    source: int
    groups: tuple[int, int]


@dataclass(frozen=True)
class PyramidLayout:
    """The levels of the pyramid of a picture of `size` (width, height); `levels[0]` is level 1."""

    size: tuple[int, int]
    levels: tuple[Level, ...]

    @classmethod
    def of(cls, size: tuple[int, int]) -> PyramidLayout:
        """Return the layout for a picture of `size`; a picture of one pixel has one level, too."""
        levels: list[Level] = []
        (width, height), first = size, 0
        while not levels or max(width, height) > 1:
            width, height = -(-width // 2), -(-height // 2)
            levels.append(Level(width, height, first))
            first += width * height
        return cls(size, tuple(levels))

    @property
    def words(self) -> int:
        """The number of float32 in the buffer. Behind the last level is the picture itself."""
        return self.picture + self.size[0] * self.size[1]

    @property
    def picture(self) -> int:
        """The first word of level 0: the depths of the picture, row by row."""
        last = self.levels[-1]
        return last.first + last.width * last.height

    @property
    def reductions(self) -> tuple[Reduction, ...]:
        """The dispatches that fill the buffer, each of which reads what the one before wrote; two up to 4096 pixels."""
        dispatches = []
        for source in range(0, len(self.levels), STEP):
            width, height = self.extent(source)
            dispatches.append(Reduction(source, (-(-width // TILE), -(-height // TILE))))
        return tuple(dispatches)

    def extent(self, level: int) -> tuple[int, int]:
        """Return (width, height) of a level; level 0 is the picture."""
        if level == 0:
            return self.size
        return self.levels[level - 1].width, self.levels[level - 1].height

    def constants(self, reduction: Reduction) -> NDArray[np.uint32]:
        """Return the push constants (4,) of a dispatch: level of the source, size of the picture."""
        return np.array([reduction.source, *self.size, 0], np.uint32)
