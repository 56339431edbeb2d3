"""Offset allocators: they hand out ranges of a buffer or of GPU memory and never touch the bytes themselves.

Which one fits depends on the order of release: all at once (`LinearAllocator`), last in first out
(`StackAllocator`, `DoubleEndedAllocator`), or any (`BlockAllocator`). Sizes, offsets and alignments are
bytes, or whatever the caller counts in.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterator
from itertools import chain
from typing import Literal

from common.errors import StrataError


class OutOfSpaceError(StrataError):
    """A fixed range has no room left for a request."""


def align_up(value: int, alignment: int) -> int:
    """Return the smallest multiple of `alignment` (any positive number) that is not below `value`."""
    return -(-value // alignment) * alignment


def _check(size: int, alignment: int) -> None:
    if size <= 0 or alignment <= 0:
        raise ValueError(f"cannot allocate {size} bytes aligned to {alignment}: both must be positive")


class LinearAllocator:
    """Hands out one range after the other and takes all back at once: what is written anew each frame."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.used = 0

    def alloc(self, size: int, alignment: int = 1) -> int:
        """Return the offset of a new range; raises OutOfSpaceError, changing nothing, if it does not fit."""
        _check(size, alignment)
        offset = align_up(self.used, alignment)
        if offset + size > self.capacity:
            raise OutOfSpaceError(f"{size} bytes do not fit: {self.used} of {self.capacity} are used")
        self.used = offset + size
        return offset

    def reset(self) -> None:
        """Take everything back."""
        self.used = 0


class StackAllocator(LinearAllocator):
    """A linear allocator that can go back to any earlier point, padding for alignment included."""

    def marker(self) -> int:
        """Return the present top, for `free_to`."""
        return self.used

    def free_to(self, marker: int) -> None:
        """Take back everything handed out since `marker`; raises ValueError for a marker above the top."""
        if not 0 <= marker <= self.used:
            raise ValueError(f"marker {marker} is not on a stack of height {self.used}")
        self.used = marker


class DoubleEndedAllocator:
    """Two stacks that grow towards each other: long-lived ranges below, short-lived above."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.bottom = 0  # first free byte
        self.top = capacity  # first byte that the upper stack uses

    @property
    def used(self) -> int:
        """Bytes of both stacks, padding included."""
        return self.bottom + self.capacity - self.top

    def alloc(self, size: int, alignment: int = 1, end: Literal["bottom", "top"] = "bottom") -> int:
        """Return the offset of a new range at one end; raises OutOfSpaceError where the two would meet."""
        _check(size, alignment)
        if end == "bottom":
            offset = align_up(self.bottom, alignment)
            fits = offset + size <= self.top
        else:
            offset = (self.top - size) // alignment * alignment
            fits = offset >= self.bottom
        if not fits:
            raise OutOfSpaceError(f"{size} bytes do not fit between {self.bottom} and {self.top}")
        if end == "bottom":
            self.bottom = offset + size
        else:
            self.top = offset
        return offset

    def marker(self, end: Literal["bottom", "top"]) -> int:
        """Return the present limit of one end, for `free_to`."""
        return self.bottom if end == "bottom" else self.top

    def free_to(self, marker: int, end: Literal["bottom", "top"]) -> None:
        """Take back what one end handed out since `marker`; raises ValueError for a foreign marker."""
        if end == "bottom":
            if not 0 <= marker <= self.bottom:
                raise ValueError(f"marker {marker} is not in the bottom stack of height {self.bottom}")
            self.bottom = marker
        else:
            if not self.top <= marker <= self.capacity:
                raise ValueError(f"marker {marker} is not in the top stack, which begins at {self.top}")
            self.top = marker


class BlockAllocator:
    """Sub-allocates one block of memory in any order, best fit first, and merges freed neighbours at once.

    Best fit keeps large holes whole. The holes are kept sorted by (size, offset), so finding one is a
    binary search and a new one shifts the rest in one memory move. No two holes ever touch.
    """

    def __init__(self, capacity: int) -> None:
        if capacity <= 0:
            raise ValueError(f"a block of {capacity} bytes holds nothing")
        self.capacity = capacity
        self.used = 0
        self._sizes: dict[int, int] = {}  # of live ranges, by offset
        self._holes: list[tuple[int, int]] = [(capacity, 0)]  # (size, offset), sorted
        self._hole_at: dict[int, int] = {0: capacity}  # offset -> size
        self._hole_ending: dict[int, int] = {capacity: 0}  # end -> offset

    def alloc(self, size: int, alignment: int = 1) -> int | None:
        """Return the offset of a new range, or None if no hole has room for it."""
        _check(size, alignment)
        tight = bisect_left(self._holes, (size, 0))
        certain = bisect_left(self._holes, (size + alignment - 1, 0))  # from here on every hole fits
        # A tight hole is large enough but may not be so from an aligned offset on: a few are tried, then the
        # smallest certain one, and only a block without any has all its tight holes searched.
        few = min(tight + 8, certain)
        for index in chain(range(tight, few), range(certain, len(self._holes)), range(few, certain)):
            hole_size, hole = self._holes[index]
            offset = align_up(hole, alignment)
            if offset + size <= hole + hole_size:
                self._remove_hole(hole, hole_size)
                self._add_hole(hole, offset - hole)
                self._add_hole(offset + size, hole + hole_size - (offset + size))
                self._sizes[offset] = size
                self.used += size
                return offset
        return None

    def free(self, offset: int) -> None:
        """Give a range back; raises ValueError if none begins there (freed twice, or never handed out)."""
        size = self._sizes.pop(offset, None)
        if size is None:
            raise ValueError(f"no live range begins at offset {offset}")
        self.used -= size
        end = offset + size
        if offset in self._hole_ending:
            before = self._hole_ending[offset]
            self._remove_hole(before, offset - before)
            offset = before
        if end in self._hole_at:
            after = self._hole_at[end]
            self._remove_hole(end, after)
            end += after
        self._add_hole(offset, end - offset)

    @property
    def largest_free(self) -> int:
        """Bytes of the largest hole."""
        return self._holes[-1][0] if self._holes else 0

    @property
    def free_count(self) -> int:
        """Number of holes."""
        return len(self._holes)

    @property
    def fragmentation(self) -> float:
        """0 if all free bytes are one hole, towards 1 the more holes share them."""
        free = self.capacity - self.used
        return 1.0 - self.largest_free / free if free else 0.0

    def __len__(self) -> int:
        """Return the number of live ranges."""
        return len(self._sizes)

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Iterate over the live ranges as (offset, size), by offset: for reports of leaks."""
        return iter(sorted(self._sizes.items()))

    def _add_hole(self, offset: int, size: int) -> None:
        if size:
            insort(self._holes, (size, offset))
            self._hole_at[offset] = size
            self._hole_ending[offset + size] = offset

    def _remove_hole(self, offset: int, size: int) -> None:
        del self._holes[bisect_left(self._holes, (size, offset))]
        del self._hole_at[offset]
        del self._hole_ending[offset + size]
