"""What lies in the buffers of the study, and the tiles of a picture whose paths they hold."""

from __future__ import annotations

from ...rays.tiles import GROUP, tiles

WAVE, HEAD, TOLD = "wave", "wave_head", "wave_told"
"""Paths in flight, the head with counters and arguments of dispatches, and what the CPU reads of it."""

HEAD_BYTES = 256
ROUNDS = 16
"""Rounds whose live paths are counted one by one; the last counter has all further ones, too."""
TOLD_WORDS = 2 + ROUNDS

STAGES = ("generate", "next", "extend", "shade", "shadow", "add")
"""The values of STAGE."""

LIVE_GROUPS, SHADOW_GROUPS = 0, 16
"""Byte offsets in the head of the arguments of dispatches over both queues."""

CLEARS, IS_LAST, SAMPLE_SHIFT = 0x800, 0x1000, 16
"""Bits of the fourth number that a dispatch is told; the lowest ones are the round."""


def wave_tiles(extent: tuple[int, int], count: int, paths: int) -> list[tuple[int, int, int, int]]:
    """Return (x, y, columns, rows) of `count` tiles of a picture, or more, so that each has at most so many paths."""
    while True:
        parts = tiles(extent, count)
        if max(blocks(columns, rows) for _, _, columns, rows in parts) * GROUP**2 <= paths:
            return parts
        count *= 2


def blocks(columns: int, rows: int) -> int:
    """Return the work groups of 8 x 8 paths that cover a tile."""
    return -(-columns // GROUP) * -(-rows // GROUP)
