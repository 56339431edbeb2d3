"""The plan of the layers' memory: how many of them fit, and how the counts of pixels are summed.

words     one for each pixel: its number of layers; after the prefix sum where they begin; after the fill where
          they end, which is where those of the next pixel begin
keys      16 bytes a layer: depth, instance, triangle, and the place of its colour
colors    16 bytes a layer: linear colour and opacity
"""

from __future__ import annotations

from typing import Protocol

from common.errors import SettingError

from ..shading.settings import ShadingSettings
from ..shading.views import PICTURE
from .settings import TransparencySettings

GROUP = 256
"""Invocations of a work group of the prefix sum."""

RUN = 16
"""Pixels that one invocation of the prefix sum adds up."""

HEAD = 4
"""Words before those of the pixels: the layers of the frame, the capacity, the width, and whether it is too small."""

NODE_BYTES = 16
"""Bytes of a layer in each of the two buffers: 32 in all."""

SHORT = 16
"""A list of at most so many layers is composited by repeated search; a longer one is made a heap first."""


class Settings(Protocol):
    """The settings of transparency."""

    shading: ShadingSettings
    transparency: TransparencySettings


def layered(settings: Settings) -> bool:
    """Whether blended surfaces are composited in a pass of their own; a view shows them as they are drawn."""
    return settings.transparency.mode != "sorted" and settings.shading.view == PICTURE


def uses_lists(settings: Settings) -> bool:
    """Whether each pixel has a list of its layers."""
    return layered(settings) and settings.transparency.mode == "lists"


def check(settings: Settings) -> None:
    """Raise SettingError for several samples a pixel: layers are those of the centre of a pixel."""
    if layered(settings) and settings.shading.msaa > 1:
        raise SettingError(
            f"transparency={settings.transparency.mode} composites one sample a pixel, and msaa is "
            f"{settings.shading.msaa}: set msaa=1, or transparency=sorted."
        )


def capacity_of(size: tuple[int, int], nodes: float, buffer_bytes: int) -> int:
    """Return the layers that the pool holds for a picture: `nodes` a pixel, as far as a buffer may be that large."""
    wanted = int(size[0] * size[1] * nodes)
    return max(1, min(wanted, buffer_bytes // NODE_BYTES, 2**32 - 2))


def blocks_of(pixels: int) -> int:
    """Return the blocks of the prefix sum: each has one work group."""
    return -(-pixels // (GROUP * RUN))


def sizes_of(size: tuple[int, int], capacity: int) -> dict[str, int]:
    """Return the bytes of each buffer."""
    pixels = size[0] * size[1]
    return {
        "words": 4 * (HEAD + pixels),
        "sums": 4 * blocks_of(pixels),
        "keys": NODE_BYTES * capacity,
        "colors": NODE_BYTES * capacity,
    }
