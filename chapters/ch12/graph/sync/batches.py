"""Batches: the steps of a frame that are submitted together."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wait:
    """A wait at `stages` for batch number `batch`: of the same frame, or with `before` of the previous frame.

    These stages of all later work on the queue wait. The first frame of a graph has no previous frame.
    """

    batch: int
    before: bool
    stages: frozenset[str]


@dataclass(frozen=True)
class Batch:
    """Consecutive steps of one queue in one submission, which waits at its beginning and signals at its end.

    A batch may have no steps: the first one, with the waits of externals, or the last one, with the epilogue.
    """

    queue: str
    steps: tuple[int, ...]
    waits: tuple[Wait, ...] = ()
