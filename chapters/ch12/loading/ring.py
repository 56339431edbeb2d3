"""A ring buffer of bytes: ranges are allocated in order, and freed in the same order."""

from __future__ import annotations

from collections.abc import Callable

from common.numerics.allocators import align_up


class Ring:
    """Allocates ranges of [0, capacity) that do not overlap while in use. No range wraps around the end.

    `head` and `tail` only grow. Modulo the capacity, `head` is the begin of the next range and `tail` that of the
    oldest.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.head = self.tail = 0

    @property
    def used(self) -> int:
        """Bytes in use, including gaps for alignment and at the end of the ring."""
        return self.head - self.tail

    def take(self, wanted: Callable[[int], int], alignment: int) -> tuple[int, int] | None:
        """Return (offset, bytes) of a new range, or None.

        `wanted` gets the number of contiguous free bytes and returns the number to allocate. It is called for the room
        after the last range, and if it returns 0, again for the room at the begin of the ring.
        """
        if not self.used:
            # `head` never goes back: a submission without bytes may be in flight, and `free_to` gets its mark.
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
        """Free all ranges that were allocated before `head` was `mark`."""
        self.tail = max(self.tail, mark)


def rows_that_fit(rows: int, row_bytes: int, step: int, room: int) -> int:
    """Return how many of `rows` fit into `room` bytes: all, else a multiple of `step`, perhaps 0.

    Some queues copy images only in tiles of `step` rows (minImageTransferGranularity), except at the end of the image.
    """
    return rows if rows * row_bytes <= room else room // (row_bytes * step) * step
