"""A device may refuse the memory of the pages: then they are fewer, and the scene's warnings say so. No device."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from common.errors import DeviceError

TILE_KIB = 64

Made = TypeVar("Made")


def refused(error: DeviceError) -> bool:
    """Whether a call failed for lack of memory: VK_ERROR_OUT_OF_..._MEMORY, GL_OUT_OF_MEMORY."""
    text = str(error)
    return "OUT_OF_" in text and "MEMORY" in text


def with_less(make: Callable[[int], Made], tiles: int, warnings: list[str]) -> Made:
    """Return what `make` makes of a number of tiles, of half of them if the device refuses their memory, and so on.

    Raises DeviceError if it refuses a single tile, and any other failure at once.
    """
    asked = tiles
    while True:
        try:
            pages = make(tiles)
            break
        except DeviceError as error:
            if tiles <= 1 or not refused(error):
                raise
            tiles //= 2
    tell(asked, tiles, warnings)
    return pages


def tell(asked: int, tiles: int, warnings: list[str]) -> None:
    """Add a sentence to `warnings` if there are fewer `tiles` than were asked for."""
    sentence = (
        f"The GPU has no {_shown(asked)} for shadow maps, so they share {_shown(tiles)} and are coarser: "
        "take a smaller shadow_pool, or close other programs."
    )
    if tiles < asked and sentence not in warnings:
        warnings.append(sentence)


def _shown(tiles: int) -> str:
    kib = tiles * TILE_KIB
    return f"{kib / 1024:g} MiB" if kib >= 1024 else f"{kib} KiB"
