"""A ring of bytes: ranges are taken one after the other, and given back in the order in which they were taken."""

from __future__ import annotations

from collections.abc import Callable

from common.numerics.allocators import align_up


class Ring:
    """Hands out ranges of [0, capacity) that never overlap while in use. None wraps: a copy reads it in one piece.

    `head` and `tail` only grow; modulo the capacity they are where the next range begins, and the oldest in use.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.head = self.tail = 0

    @property
    def used(self) -> int:
        """Bytes in use, with what was left out for alignment and at the end of the ring."""
        return self.head - self.tail

    def take(self, wanted: Callable[[int], int], alignment: int) -> tuple[int, int] | None:
        """Return (offset, bytes) of a new range, or None.

        `wanted` is told how many bytes there are in one piece and says how many of them to take. It is asked for the
        room behind the last range, and if it wants none of that, once more for the room from the ring's begin.
        """
        if not self.used:
            # On to the next lap, never back: a submission without bytes may still fly, and `free_to` gets its mark.
            self.head = self.tail = align_up(self.head, self.capacity)
        place = self.head % self.capacity
        lap = self.head - place
        behind, again = lap + align_up(place, alignment), lap + self.capacity
        for start, end in ((behind, again), (again, again + self.capacity)):
            room = min(end, self.tail + self.capacity) - start
            count = wanted(room) if room > 0 else 0
            if count > 0:
                self.head = start + count
                return start % self.capacity, count
        return None

    def free_to(self, mark: int) -> None:
        """Give back all that was taken before `head` was `mark`."""
        self.tail = max(self.tail, mark)


def rows_that_fit(rows: int, row_bytes: int, step: int, room: int) -> int:
    """Return how many of `rows` are copied at once into `room` bytes: all, else a multiple of `step`, perhaps 0.

    Some queues copy images only in tiles of so many rows (minImageTransferGranularity), down to the image's end.
    """
    return rows if rows * row_bytes <= room else room // (row_bytes * step) * step
