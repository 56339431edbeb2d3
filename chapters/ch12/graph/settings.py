"""The knobs of the frame graph."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

POISONS = ("off", "depth 0", "depth 1")
"""The choices of the knob `poison`. Depth images get this depth, floats NaN, integers and buffers all ones."""


@dataclass
class GraphSettings:
    """The settings of the frame graph: its file, memory, recordings and poison."""

    name: str = knob(
        "auto",
        "deferred, compute, forward or a file; auto: deferred, compute with rate_policy, forward with msaa",
        flat="graph",
    )
    alias: bool = knob(True, "whether targets that are never needed at the same time share memory")
    resubmit: bool = knob(True, "whether frames are recorded once and sent again until something changes")
    poison: str = knob("off", "what fills memory before its first use: NaN and this depth", choices=POISONS)
