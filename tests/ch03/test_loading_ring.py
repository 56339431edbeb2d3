"""The ring of staging memory: ranges that never overlap while in use, whatever their sizes, and images cut by rows."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from chapters.ch03.loading.ring import Ring, rows_that_fit


@pytest.mark.feature("async-loading/staging-buffer")
@pytest.mark.parametrize("seed", range(6))
def test_ranges_in_use_never_overlap(seed):
    random = np.random.default_rng(seed)
    capacity = int(random.integers(64, 5000))
    ring, used, laps = Ring(capacity), deque(), 0
    for _ in range(3000):
        if used and random.random() < 0.5:
            ring.free_to(used.popleft()[2])
        alignment = math.lcm(int(random.choice([1, 2, 4, 8, 16])), int(random.choice([1, 3, 4, 12])))
        size = int(random.integers(1, capacity // 2))
        taken = ring.take(lambda room, size=size: size if size <= room else 0, alignment)
        if taken is None:
            if not used:
                assert size > capacity, "an empty ring has room for all that fits into it"
            continue
        offset, count = taken
        assert count == size and offset % alignment == 0 and 0 <= offset <= capacity - size
        assert all(end <= offset or offset + size <= start for start, end, _ in used)
        laps += bool(used) and offset < used[-1][0]
        used.append((offset, offset + size, ring.head))
        assert ring.used <= capacity
    assert laps > 10, "it went round"


def test_a_mark_from_when_the_ring_was_empty_gives_nothing_back_that_was_taken_since():
    """A submission without bytes, as one that makes mip levels alone, ends after others have begun to take."""
    ring = Ring(64)
    ring.take(lambda room: min(room, 50), 1)
    ring.free_to(ring.head)
    mark = ring.head  # of a submission that takes nothing
    assert ring.take(lambda room: min(room, 40), 1) == (0, 40)
    ring.free_to(mark)
    assert ring.used >= 40
    place = ring.take(lambda room: min(room, 30), 1)
    assert place is not None and place[0] >= 40


@pytest.mark.feature("async-loading/staging-buffer")
def test_an_empty_ring_gives_all_of_itself_wherever_it_stood():
    ring = Ring(100)
    assert ring.take(lambda room: 30, 1) == (0, 30)
    ring.free_to(ring.head)
    assert ring.take(lambda room: room, 16) == (0, 100)
    assert ring.take(lambda room: room, 1) is None


def test_room_from_the_begin_is_offered_where_that_behind_is_too_little():
    ring = Ring(100)
    assert ring.take(lambda room: 60, 1) == (0, 60)
    mark = ring.head
    assert ring.take(lambda room: 30, 1) == (60, 30)
    ring.free_to(mark)
    offered = []
    assert ring.take(lambda room: offered.append(room) or (50 if room >= 50 else 0), 4) == (0, 50)
    assert offered == [8, 60]


@pytest.mark.parametrize("step", [1, 3, 8])
def test_parts_by_rows_make_the_whole_in_tiles_of_the_queue(step):
    random = np.random.default_rng(step)
    for _ in range(200):
        rows, row_bytes = (int(n) for n in random.integers(1, 100, 2))
        done = 0
        while done < rows:
            room = int(random.integers(row_bytes * step, 3 * row_bytes * step + 100))
            count = rows_that_fit(rows - done, row_bytes, step, room)
            assert 0 < count * row_bytes <= room
            assert done % step == 0 and (count % step == 0 or done + count == rows)
            done += count
    assert rows_that_fit(10, 4, 4, 15) == 0, "a tile is not cut"
