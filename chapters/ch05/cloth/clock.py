"""When cloth is simulated: from its beginning in fixed steps, never for longer than a frame may take, and not at rest.

    clock = ClothClock(count=2, dt=1 / 60)
    due = clock.frame(time, reset="", key=what_acts_on_it)    # due.count steps; clock.active says which cloths
    clock.told(mark, tested, calm)                            # what the GPU said of a frame that is over

What a cloth does is a function of how many steps it has made, never of the times at which somebody looked: a frame
simulates the steps that have become due, all of the same length.

A cloth is *at rest* when it hardly moved for a while and nothing that acts on it has changed since: forces, what holds
it, what is in its way. It is not simulated then, until something changes. Whether it hardly moves, the GPU says; the
answer is read when the slot of its frame is used again, so that nobody waits, and always the same frames later.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .steps import Due, due_steps

KEEPS_ON = frozenset({"", "resize", "camera cut"})
"""Why a frame may be without history while its cloth goes on: only the picture or the view is another one. Time may run
backwards at the same moment, and then it does not."""

CALM_SECONDS = 0.5
"""For how long a cloth must have been calm before it is at rest: at the end of a swing it stands still, too."""


class ClothClock:
    """Which steps each frame simulates, of which of `count` cloths; steps are `dt` seconds long."""

    def __init__(self, count: int, dt: float) -> None:
        self.dt = dt
        self.done = 0
        """Steps that have become due since the cloths hung at rest at time 0, those included that were skipped."""
        self.at_rest: NDArray[np.bool_] = np.zeros(count, bool)
        self.began = False
        """Whether the cloths have to begin anew in this frame, as they were modelled."""
        self._key: Any = None
        self._time = float("-inf")  # of the last frame
        self._since = np.zeros(count, np.int64)  # step from which on a calm cloth counts as such
        self._round = 0

    def frame(self, time: float, reset: str, key: Sequence[Any]) -> Due:
        """Return what a frame at `time` seconds simulates.

        `reset` is why it has no history, or "". `key` is all that acts on the cloths: whenever it is another one, all
        wake.
        """
        self._begin(time, reset)
        if key != self._key:
            self._key = key
            self.wake()
        due = due_steps(time, self.done, self.dt)
        self.done = due.reached
        return due

    def moves(self, time: float) -> bool:
        """Whether a frame at `time` simulates, or begins anew."""
        return time < self._time or due_steps(time, self.done, self.dt).reached > self.done

    def kept(self) -> Self:
        """Return the clock as it is now, whatever becomes of this one."""
        clock = copy(self)
        clock.at_rest, clock._since = self.at_rest.copy(), self._since.copy()
        return clock

    def pause(self, time: float, reset: str = "") -> None:
        """Let time go by up to that of a frame in which nothing is simulated: it is no skipping, and no calm."""
        self._begin(time, reset)
        reached = due_steps(time, self.done, self.dt).reached
        self._since += reached - self.done
        self.done = reached
        if self.began:
            self.wake()

    def _begin(self, time: float, reset: str) -> None:
        """Begin anew where a frame at `time` has no history."""
        self.began = reset not in KEEPS_ON or time < self._time
        self._time = time
        if self.began:
            self.done, self._key = 0, None
            self._round += 1

    def wake(self) -> None:
        """Simulate all cloths again."""
        self.at_rest[:] = False
        self._since[:] = self.done

    def mark(self) -> tuple[int, int]:
        """Return what a frame has to be remembered by until the GPU tells of it: see `told`."""
        return self._round, self.done

    def goes_on(self, mark: tuple[int, int]) -> bool:
        """Whether the cloths have not begun anew since then."""
        return mark[0] == self._round

    def told(self, mark: tuple[int, int], tested: NDArray[np.bool_], calm: NDArray[np.bool_]) -> None:
        """Take in which of the cloths that were simulated (`tested`, (C,)) were `calm` at the end of that frame.

        A cloth that was is at rest, if it had been calm for CALM_SECONDS: one that moved begins to count anew. Frames
        of before the cloths began anew, or were woken, say nothing.
        """
        done = mark[1]
        if not self.goes_on(mark):
            return
        moved = tested & ~calm & (done >= self._since)
        self._since[moved] = done
        self.at_rest |= tested & calm & ((done - self._since) * self.dt >= CALM_SECONDS)
