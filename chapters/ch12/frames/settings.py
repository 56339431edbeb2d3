"""The knobs of recording."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class FrameSettings:
    """How frames are recorded."""

    recording_threads: int = knob(
        0, "threads beside the renderer's own that record draws; in Python no gain", minimum=0, maximum=32
    )
    draws_per_secondary: int = knob(
        256, "calls that a part of a pass has at least when threads record it", minimum=1, maximum=1_000_000
    )
