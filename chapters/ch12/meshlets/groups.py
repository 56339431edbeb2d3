"""Sorting and grouping of whole numbers, the steps of which the builder of meshlets consists.

All of it works on arrays of the whole scene at once, and is linear in their length.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.integer[Any]]
Int64 = NDArray[np.int64]

_DIGIT = 16


def sorting_order(*keys: Ints) -> Int64:
    """Return (N,) the stable order by the last of some keys, equal ones by the key before, as `np.lexsort` does.

    Keys are (N,) and not negative. The sort is a radix sort: from the lowest 16 bits of the first key to the highest of
    the last, each a stable sort of 16-bit numbers, for which numpy counts instead of comparing. For 300,000 keys it is
    four times as fast as `np.argsort`.
    """
    order: Int64 | None = None
    for key in keys:
        for shift in range(0, int(key.max(initial=0)).bit_length(), _DIGIT):
            digits = (key >> shift).astype(np.uint16)
            if order is None:
                order = np.argsort(digits, kind="stable")
            else:
                order = order[np.argsort(digits[order], kind="stable")]
    return np.arange(len(keys[0])) if order is None else order


def group_starts(groups: NDArray[Any]) -> Int64:
    """Return where a group of equal neighbours begins, (G,)."""
    changes = np.ones(len(groups), bool)
    np.not_equal(groups[1:], groups[:-1], out=changes[1:])
    return np.flatnonzero(changes)


def sizes_of(starts: Int64, total: int) -> Int64:
    """Return how long the groups that begin at `starts` (G,) are, the last one up to `total`."""
    return np.diff(np.append(starts, total))


def spans(first: Ints, count: Ints) -> Int64:
    """Return first[0], first[0] + 1, ... (`count[0]` of them), first[1], ...: the numbers of ranges, one by one."""
    counts = count.astype(np.int64)
    before = np.cumsum(counts) - counts
    return np.arange(counts.sum()) + np.repeat(first.astype(np.int64) - before, counts)


def batches(counts: Ints, most: int) -> list[slice]:
    """Return slices of N things, in batches of about `most` by their `counts` (N,); the last thing may exceed that."""
    before = np.cumsum(counts, dtype=np.int64) - counts
    starts = [*group_starts(before // most).tolist(), len(counts)]
    return [slice(first, last) for first, last in pairwise(starts)]


def previous_use(vertices: Ints) -> NDArray[np.int32]:
    """Return (C,) for each corner of a list of triangles the last corner before it with the same vertex, or -1.

    In the part of the list that begins at corner b, a corner is the first of its vertex if its number here is below b.
    So the distinct vertices of any part can be counted without another sort.
    """
    order = sorting_order(vertices)
    again = np.diff(vertices[order]) == 0
    previous = np.full(len(vertices), -1, np.int32)
    previous[order[1:][again]] = order[:-1][again]
    return previous
