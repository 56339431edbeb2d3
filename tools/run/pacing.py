"""Frames in a row, as a window and a recorded path draw them, and their times for a renderer that follows these."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from backends.pacing import Paced

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.view.camera import View

LATENCY = 2
"""Frames after which figures of the GPU are read: by then the renderer itself has waited for them."""


class Pacer:
    """Draws frames, and hands their times to a renderer that asks for them, right before the next frame."""

    def __init__(self) -> None:
        self._unread: deque[Frame] = deque()
        self._renderer: Renderer | None = None

    def render(self, renderer: Renderer, view: View, time: float) -> Frame:
        """Return the next frame; no other one is waited for."""
        if not isinstance(renderer, Paced):
            return renderer.render(view, time)
        if renderer is not self._renderer:  # the frames of another one say nothing about this one
            self._unread.clear()
            self._renderer = renderer
        if len(self._unread) >= LATENCY:
            renderer.pace(sum(self._unread.popleft().timings.values()))
        frame = renderer.render(view, time)
        self._unread.append(frame)
        return frame
