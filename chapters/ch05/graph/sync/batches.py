"""Batches: the steps of a frame that are submitted together."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wait:
    """A wait of a batch for the batch `number` of the same frame, or of the frame `before`, at `stages`.

    The wait holds these stages of all later work on the queue. The first frame of a graph has no frame before it.
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
