"""The light lists without a device: which scenes have them, and how their buffer is laid out.

One buffer holds everything, in words of 32 bits:

    header   HEADER words: number of words in a tile's bits, tiles in a row, pixels of a tile as a power of two, ...
    order    a word a light: the lights, nearest first
    bounds   BOUND words a light, in that order: the circle that the light covers in the picture, its interval of depth
    found    the same, in the order of the records; the first kernel writes them, and the second one sorts them
    bins     a word a bin: first and last place in the order of the lights that reach into its interval of depth
    depths   a word for each 32 lights of each bin: a bit a light, in the order
    tiles    the same of each tile

Sources: Persson and Olsson, "Practical Clustered Deferred and Forward Shading", SIGGRAPH 2013, for lists by place and
depth; Drobot, "Improved Culling for Tiled and Clustered Rendering", SIGGRAPH 2017, for bins and bits instead of lists.
There a bin has its two places only. Where ranges differ, half of the lights between them do not reach into the bin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, get_args

from common.errors import UnsupportedError
from common.scene import Scene

from .settings import ClusterSettings, Lists

LEAST_LIGHTS = 8
"""With fewer lights a pixel evaluates all: to look into a list costs more than it saves."""

HEADER, BOUND = 16, 8
"""Words of the header, and of the bounds of a light."""

OCTAVES, STEPS_LOG2 = 8, 6
BINS = OCTAVES << STEPS_LOG2
"""Bins of depth: each factor of two in distance, counted from the farthest light, has 64 equal ones.

A float32 is an exponent and a mantissa, so its bits, read as an integer, are a piecewise linear logarithm. The highest
15 bits number exactly these bins, and no logarithm is computed. At 10 m a bin is 0.125 m deep.
"""

TILE_LOG2 = 3
"""Tiles of 8x8 pixels, or larger ones where a buffer of the device does not hold so many."""

GROUP = 64
"""Invocations of a work group of the kernels."""


class Settings(Protocol):
    """The settings of the light lists."""

    clusters: ClusterSettings


def needed(scene: Scene, settings: Settings) -> bool:
    """Whether the scene has lights enough for an order; brute force sums them in that order, too."""
    return min(len(scene.lights), settings.clusters.most_lights) >= LEAST_LIGHTS


def list_defines(scene: Scene, settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the defines of all shaders of a scene with light lists: what selects lights, and the buffer's layout.

    Bit 0 of LIGHT_LISTS is set for bins, bit 1 for tiles.
    """
    if not needed(scene, settings):
        return ()
    return (
        ("LIGHT_LISTS", get_args(Lists).index(settings.clusters.light_lists)),
        ("LIST_HEADER", HEADER),
        ("LIST_BOUND", BOUND),
        ("LIST_BINS", BINS),
        ("LIST_STEPS_LOG2", STEPS_LOG2),
        ("LIST_GROUP", GROUP),
    )


def loop_defines(settings: Settings, subgroups: bool) -> tuple[tuple[str, int], ...]:
    """Return the define of the scalarised loop, where the device has arithmetic in subgroups."""
    return (("SCALARISED", 1),) if subgroups and settings.clusters.light_loop == "scalarised" else ()


@dataclass(frozen=True)
class ListLayout:
    """The places of the parts in the buffer, in words, for `lights` and a picture of `size` pixels."""

    lights: int
    size: tuple[int, int]
    tile_log2: int

    @staticmethod
    def of(lights: int, size: tuple[int, int], most_bytes: int) -> ListLayout:
        """Return the layout with the smallest tiles that fit into `most_bytes`.

        Raises UnsupportedError if not even tiles of 256x256 pixels do.
        """
        for tile_log2 in range(TILE_LOG2, 9):
            layout = ListLayout(lights, size, tile_log2)
            if layout.words * 4 <= most_bytes:
                return layout
        raise UnsupportedError(
            f"The lists of {lights} lights take {layout.words * 4} bytes for a picture of {size[0]}x{size[1]}, and "
            f"shaders of this device see {most_bytes}: draw a smaller picture, or set most_lights lower."
        )

    @property
    def words_of_set(self) -> int:
        """Words of the bits of one tile, or of one bin."""
        return -(-self.lights // 32)

    @property
    def tiles(self) -> tuple[int, int]:
        """Tiles in a row and in a column; the last ones reach beyond the picture."""
        width, height = (-(-pixels >> self.tile_log2) for pixels in self.size)
        return width, height

    @property
    def first_bound(self) -> int:
        """The first word of the bounds in the order of depth."""
        return HEADER + self.lights

    @property
    def first_found(self) -> int:
        """The first word of the bounds in the order of the records."""
        return self.first_bound + BOUND * self.lights

    @property
    def first_bin(self) -> int:
        """The first word of the bins."""
        return self.first_found + BOUND * self.lights

    @property
    def first_depth(self) -> int:
        """The first word of the bits of the bins."""
        return self.first_bin + BINS

    @property
    def first_tile(self) -> int:
        """The first word of the bits of the tiles."""
        return self.first_depth + BINS * self.words_of_set

    @property
    def words(self) -> int:
        """Words of the whole buffer."""
        width, height = self.tiles
        return self.first_tile + width * height * self.words_of_set

    @property
    def pushed(self) -> tuple[int, ...]:
        """The words with which the header begins, as the kernels get them (clusters/layout.glsl)."""
        return self.lights, self.words_of_set, self.tiles[0], self.tile_log2
