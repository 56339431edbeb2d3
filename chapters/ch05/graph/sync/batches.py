"""What of a frame is submitted together, in the frame graph's words."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wait:
    """What a batch waits for: the batch of this number, of the same frame or of the one `before` it, in `stages`.

    The stages are those of the whole queue from here on. The first frame of a graph waits for none of the one before.
    """

    batch: int
    before: bool
    stages: frozenset[str]


@dataclass(frozen=True)
class Batch:
    """Steps in a row of one queue that are submitted together: it waits at its beginning and signals at its end.

    It may have no steps: in front of all others, for what externals wait for, or behind them, with the epilogue.
    """

    queue: str
    steps: tuple[int, ...]
    waits: tuple[Wait, ...] = ()
