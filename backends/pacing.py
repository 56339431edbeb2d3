"""A renderer that follows the time of its frames: what a window tells it between two of them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


@runtime_checkable
class Paced(Protocol):
    """A renderer that adapts the work of its next frames to how long the last ones took.

    `render` itself never does so: the same calls give the same pixels.
    """

    def pace(self, frame_ms: float) -> None:
        """Take the milliseconds that a finished frame took on the GPU; called between two frames."""
