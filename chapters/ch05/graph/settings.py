"""The knobs of the frame graph."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob

POISONS = ("off", "depth 0", "depth 1")
"""What the knob `poison` chooses from: it names the depth, all else gets NaN."""


@dataclass
class GraphSettings:
    """Which graph a frame takes, and what is kept between frames."""

    name: str = knob(
        "auto", "deferred, compute, forward or a file; auto: deferred, but forward with msaa", flat="graph"
    )
    alias: bool = knob(True, "whether targets that are never needed at the same time share memory")
    resubmit: bool = knob(True, "whether frames are recorded once and sent again until something changes")
    poison: str = knob("off", "what fills memory before its first use: NaN and this depth", choices=POISONS)
