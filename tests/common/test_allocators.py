"""Allocators against a plain byte map: ranges are aligned, never overlap, and come back whole."""

from __future__ import annotations

import random

import pytest

from common.numerics.allocators import (
    BlockAllocator,
    DoubleEndedAllocator,
    LinearAllocator,
    OutOfSpaceError,
    StackAllocator,
    align_up,
)

ALIGNMENTS = (1, 2, 4, 16, 64, 256)


class ByteMap:
    """The truth: which bytes are taken."""

    def __init__(self, capacity):
        self.taken = bytearray(capacity)
        self.ranges = {}

    def take(self, offset, size, alignment):
        assert offset >= 0 and offset + size <= len(self.taken) and offset % alignment == 0
        assert not any(self.taken[offset : offset + size]), "overlaps a live range"
        self.taken[offset : offset + size] = b"\1" * size
        self.ranges[offset] = size

    def give(self, offset):
        size = self.ranges.pop(offset)
        self.taken[offset : offset + size] = bytes(size)

    def holes(self):
        return [len(run) for run in bytes(self.taken).split(b"\1") if run]


def test_align_up():
    assert [align_up(v, 4) for v in (0, 1, 4, 5)] == [0, 4, 4, 8]
    assert align_up(10, 7) == 14  # any alignment, not powers of two alone


@pytest.mark.feature("core/linear-stack-allocators")
def test_linear():
    rng = random.Random(1)
    linear = LinearAllocator(10_000)
    for _ in range(20):
        linear.reset()
        truth, last = ByteMap(10_000), 0
        while True:
            size, alignment = rng.randint(1, 300), rng.choice(ALIGNMENTS)
            if align_up(last, alignment) + size > 10_000:
                with pytest.raises(OutOfSpaceError):
                    linear.alloc(size, alignment)
                assert linear.used == last
                break
            truth.take(offset := linear.alloc(size, alignment), size, alignment)
            last = offset + size


@pytest.mark.feature("core/linear-stack-allocators")
def test_stack_rolls_back_exactly():
    rng = random.Random(2)
    stack, truth, markers = StackAllocator(5_000), ByteMap(5_000), []
    exhausted = 0
    for _ in range(3_000):
        action = rng.random()
        if action < 0.6:
            size, alignment = rng.randint(1, 200), rng.choice(ALIGNMENTS)
            try:
                truth.take(stack.alloc(size, alignment), size, alignment)
            except OutOfSpaceError:
                exhausted += 1
                assert align_up(stack.used, alignment) + size > 5_000
        elif action < 0.8:
            markers.append((stack.marker(), list(truth.ranges)))
        elif markers:
            marker, live = markers.pop(rng.randrange(max(0, len(markers) - 3), len(markers)))
            markers = [m for m in markers if m[0] <= marker]
            stack.free_to(marker)
            assert stack.used == marker
            for offset in set(truth.ranges) - set(live):
                truth.give(offset)
            assert stack.alloc(1) == marker
            stack.free_to(marker)
    assert exhausted > 10
    with pytest.raises(ValueError, match="not on a stack"):
        stack.free_to(stack.used + 1)


@pytest.mark.feature("core/linear-stack-allocators")
def test_double_ended_stacks_meet_but_never_cross():
    rng = random.Random(3)
    both, truth = DoubleEndedAllocator(5_000), ByteMap(5_000)
    markers = {"bottom": [], "top": []}
    exhausted = 0
    for _ in range(3_000):
        end = rng.choice(("bottom", "top"))
        if rng.random() < 0.6:
            size, alignment = rng.randint(1, 300), rng.choice(ALIGNMENTS)
            marker = both.marker(end)
            try:
                offset = both.alloc(size, alignment, end)
            except OutOfSpaceError:
                exhausted += 1
                assert both.top - both.bottom < size + alignment and both.marker(end) == marker
                continue
            truth.take(offset, size, alignment)
            markers[end].append((marker, offset))
        elif markers[end]:
            marker, offset = markers[end].pop()
            both.free_to(marker, end)
            truth.give(offset)
            assert both.marker(end) == marker
        assert both.used == 5_000 - (both.top - both.bottom) >= sum(truth.ranges.values())
    assert exhausted > 10
    with pytest.raises(ValueError, match="bottom stack"):
        both.free_to(both.bottom + 1, "bottom")
    with pytest.raises(ValueError, match="top stack"):
        both.free_to(both.top - 1, "top")


@pytest.mark.feature("device/memory-suballocator")
def test_block_keeps_alignment_and_merges_neighbours():
    rng = random.Random(4)
    block, truth, refused = BlockAllocator(8_192), ByteMap(8_192), 0
    for step in range(6_000):
        if rng.random() < 0.55 or not truth.ranges:
            size, alignment = rng.choice((rng.randint(1, 40), rng.randint(1, 600))), rng.choice(ALIGNMENTS)
            offset = block.alloc(size, alignment)
            if offset is None:
                refused += 1
                free = bytes(8_192)
                spots = range(0, 8_192 - size + 1, alignment)
                assert not any(truth.taken[s : s + size] == free[:size] for s in spots), (
                    "it would have fitted"
                )
            else:
                truth.take(offset, size, alignment)
        else:
            offset = rng.choice(list(truth.ranges))
            block.free(offset)
            truth.give(offset)
        if step % 50 == 0:
            holes = truth.holes()  # maximal runs: equal only if neighbours were merged
            assert block.used == sum(truth.taken) and len(block) == len(truth.ranges)
            assert block.free_count == len(holes) and block.largest_free == max(holes, default=0)
            assert list(block.ranges()) == sorted(truth.ranges.items())
    assert refused > 100
    for offset in list(truth.ranges):
        block.free(offset)
    assert (block.used, block.free_count, block.largest_free, block.fragmentation) == (0, 1, 8_192, 0.0)
    assert block.alloc(8_192) == 0 and block.alloc(1) is None and block.largest_free == 0


@pytest.mark.feature("device/memory-suballocator")
def test_block_prefers_the_tightest_hole():
    block = BlockAllocator(1_000)
    offsets = [block.alloc(size) for size in (100, 10, 50, 10, 200, 10)]
    for index in (0, 2, 4):
        block.free(offsets[index])
    assert block.alloc(45) == offsets[2] and block.alloc(120) == offsets[4] and block.alloc(100) == offsets[0]
    assert block.fragmentation == pytest.approx(1 - block.largest_free / (1_000 - block.used))


def test_misuse_is_refused():
    block = BlockAllocator(100)
    offset = block.alloc(10)
    block.free(offset)
    with pytest.raises(ValueError, match="no live range"):
        block.free(offset)
    for size, alignment in ((0, 1), (-1, 1), (1, 0)):
        for allocator in (block, LinearAllocator(10), DoubleEndedAllocator(10)):
            with pytest.raises(ValueError, match="positive"):
                allocator.alloc(size, alignment)
    with pytest.raises(ValueError, match="holds nothing"):
        BlockAllocator(0)
