"""The tiles in which a picture is traced, so that no dispatch takes long. No device.

Systems reset a device whose dispatch takes seconds, and nothing else is drawn meanwhile. The time of a ray differs by a
factor of a thousand between devices and between scenes, so the number of tiles follows the time that was measured.
"""

from __future__ import annotations

from time import perf_counter

AIM_MS = 100.0
"""Milliseconds that a tile takes at most in the mean of a frame. Tiles differ: the limit of the slowest one is 500."""

GROUP = 8
"""Tiles begin at multiples of a work group (rays/picture.comp)."""

MOST = 1024
"""The largest number of tiles."""

RAYS_A_SECOND = {True: 2e5, False: 2e7}
"""Rays that software, or a GPU, traces in a second at least: the number of tiles of the first frame follows from it."""

EVERY = 16
"""Frames between two readings of the time while frames follow one another quickly."""


def power_of_two(least: float) -> int:
    """Return the smallest power of two, up to MOST, that is not below `least`."""
    count = 1
    while count < min(least, MOST):
        count *= 2
    return count


def first_count(rays: float, software: bool) -> int:
    """Return the number of tiles for so many rays of a picture, before anything was measured."""
    return power_of_two(2e3 * rays / RAYS_A_SECOND[software] / AIM_MS)


def next_count(count: int, milliseconds: float) -> int:
    """Return the number of tiles, of which so far `count` took `milliseconds` together.

    It grows where a tile takes more than AIM_MS in the mean, and shrinks where fewer would take half of that: a time
    that varies by less than a factor of two changes nothing.
    """
    wanted = power_of_two(2.0 * milliseconds / AIM_MS)
    return wanted if wanted < count or milliseconds > AIM_MS * count else count


def tiles(size: tuple[int, int], count: int) -> list[tuple[int, int, int, int]]:
    """Return (x, y, width, height) of about `count` tiles that cover `size` pixels once, row by row.

    The longer side of a tile is halved until they are enough, or as small as a work group.
    """
    steps = [max(side, 1) for side in size]
    parts = 1
    while parts < count and max(steps) > GROUP:
        longer = int(steps[1] >= steps[0])
        steps[longer] = -(-steps[longer] // (2 * GROUP)) * GROUP
        parts *= 2
    (width, height), (across, down) = size, steps
    return [
        (x, y, min(across, width - x), min(down, height - y))
        for y in range(0, height, down)
        for x in range(0, width, across)
    ]


class TileCount:
    """The number of tiles of a renderer's frames."""

    def __init__(self) -> None:
        self.count = 0
        self._began, self._unread = 0.0, 0

    def begin(self, rays: float, software: bool) -> None:
        """Choose the number for the first frame."""
        self.count = first_count(rays, software)

    def is_due(self) -> bool:
        """Whether the time of an earlier frame should be read; called once a frame.

        It takes a fifth of what rays may cost in Python. Frames that follow one another quickly have no long pass.
        """
        now = perf_counter()
        quick = now - self._began < 0.5e-3 * AIM_MS
        self._began, self._unread = now, self._unread + 1
        if quick and self._unread < EVERY:
            return False
        self._unread = 0
        return True

    def follow(self, milliseconds: float) -> None:
        """Follow a time of all tiles that was measured; 0 says that nothing was."""
        if milliseconds > 0.0:
            self.count = next_count(self.count, milliseconds)
