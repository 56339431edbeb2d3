"""A frozen picture in the window: a wipe between it and the live one, and how far the two are apart."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.reports import metrics
from tools.panel.reference import ReferenceState
from tools.window.stop import laid_below

if TYPE_CHECKING:
    from common.view.draw_lists import DrawList

TEXTURE = 2
"""The number of the picture's texture, beside those of the panel's glyphs and of a stop."""

EVERY_S = 0.2
"""How often the difference of moving pictures is measured: each time the picture is read back from the GPU."""


class Reference:
    """The frozen picture, (H, W, 3) uint8, and what was measured against it."""

    def __init__(self) -> None:
        self.picture: NDArray[np.uint8] | None = None
        self.state = ReferenceState()
        self.stale = False
        """Whether a picture was drawn since the last measure."""
        self._since = 0.0
        self._fresh = False  # the texture does not hold the picture yet

    def freeze(self, picture: NDArray[np.uint8], time: float) -> None:
        """Keep a picture of the scene at `time` seconds."""
        self.picture = np.ascontiguousarray(picture)
        self.state = ReferenceState(True, time, self.state.wipe)
        self.stale = self._fresh = True

    def drop(self) -> None:
        """Forget the picture."""
        self.picture, self.state, self.stale = None, ReferenceState(wipe=self.state.wipe), False

    def wipe(self, share: float) -> None:
        """Show the frozen picture in this share of the window, from the left."""
        self.state = replace(self.state, wipe=share)

    def drawn(self, passed: float) -> None:
        """Note that another picture is there, `passed` seconds after the last one."""
        self.stale = self.picture is not None
        self._since += passed
        self.state = replace(self.state, flip=None)

    def due(self, moving: bool) -> bool:
        """Whether to measure now: at once where the picture rests, else every `EVERY_S` seconds."""
        return self.stale and (not moving or self._since >= EVERY_S)

    def measure(self, live: NDArray[np.uint8], flip: bool = False) -> None:
        """Measure how far the live picture is from the frozen one; with `flip` also what a viewer sees of it."""
        assert self.picture is not None, "a picture is frozen"
        self.stale, self._since = False, 0.0
        if live.shape != self.picture.shape:
            self.state = replace(
                self.state, said="The window has another size now: freeze the picture again."
            )
            return
        difference = np.abs(live.astype(np.int16) - self.picture).max(axis=-1)
        self.state = replace(
            self.state, said="", largest=int(difference.max()), changed=float((difference > 0).mean())
        )
        if flip:
            try:
                self.state = replace(self.state, flip=metrics.flip_mean(live, self.picture))
            except UserError as error:
                self.state = replace(self.state, said=str(error))

    def under(self, drawn: DrawList | None, size: tuple[int, int]) -> DrawList | None:
        """Return `drawn` (None: nothing) with the left part of the frozen picture below it."""
        if self.picture is None or self.state.wipe == 0.0:
            return drawn
        fresh, self._fresh = self._fresh, False
        return laid_below(drawn, size, TEXTURE, self.picture, fresh, self.state.wipe)
