"""The controller of dynamic resolution: from the times of frames to one of eight scales. It knows no graphics API.

The model: a frame at scale s costs a s^2, since shading dominates. From m ms at scale s follow m (t / s)^2 ms at scale
t. A part that does not depend on the scale makes the true cost of a larger scale smaller, and that of a smaller one
larger: a step up never exceeds the target, and a step down may be followed by another one.

The rule, with the median m of the last WINDOW frames since a change:

    m > target                         down, to the largest scale whose cost is at most LANDING of the target
    a larger scale costs at most
    ROOM of the target                 up, to the largest of these

Between both lies a band in which nothing changes. Neighbouring scales differ in cost by a factor of 1.22, so a scale
that costs 0.66 to 1 of the target stays, and both rules lead into that band.

After each change LATE frames are left out, which the GPU had begun before, and then WINDOW frames are awaited. A median
does not follow single frames, such as those in which a driver compiles.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median

from common.errors import SettingError, UserError

COUNT = 8
SCALES = tuple(2.0 ** ((number + 1 - COUNT) / (COUNT - 1)) for number in range(COUNT))
"""Sides of what is drawn, in sides of the picture: 0.5 to 1, in a constant ratio."""

ROOM = 0.8
"""Part of the target that a larger scale may cost."""

LANDING = 0.95
"""Part of the target that a smaller scale may cost."""

WINDOW = 23
"""Frames whose median decides: an odd number, so that it is one of their times and no mean of two loads."""

LATE = 3
"""Frames after a change whose times are those of frames before it."""

FOLLOWS = LATE + WINDOW
"""Frames after which a step of the load is followed if the cost is a s^2."""

MOST_MS = 10_000.0
"""The longest time of a frame that can be held, in milliseconds."""


class Controller:
    """Chooses a scale for the next frame from the time of the last one.

    Raises SettingError for a target that is not a time above 0, and UserError for a number that no scale has.
    """

    def __init__(self, target_ms: float, number: int = COUNT - 1) -> None:
        if not (math.isfinite(target_ms) and 0.0 < target_ms <= MOST_MS):
            raise SettingError(
                f"target_ms={target_ms:g} is no time of a frame: give milliseconds above 0, at most {MOST_MS:g}."
            )
        self.target_ms, self.number = target_ms, check_number(number)
        self._late = 0
        self._times: deque[float] = deque(maxlen=WINDOW)

    def next(self, frame_ms: float) -> int:
        """Return the number of the scale for the next frame; `frame_ms` is the time of a finished one.

        A time that is not a number, not finite, 0 or less was not measured, and is ignored.
        """
        if not (math.isfinite(frame_ms) and frame_ms > 0.0):
            return self.number
        if self._late:
            self._late -= 1
            return self.number
        self._times.append(frame_ms)
        if len(self._times) == WINDOW:
            self.go_on(self._chosen(median(self._times)))
        return self.number

    def go_on(self, number: int) -> None:
        """Go on from another scale, whatever the reason for the change."""
        if number != self.number:
            self.number, self._late = check_number(number), LATE
            self._times.clear()

    def _chosen(self, ms: float) -> int:
        costs = [ms * (scale / SCALES[self.number]) ** 2 for scale in SCALES]
        if ms > self.target_ms:
            lower = (number for number in range(self.number) if costs[number] <= LANDING * self.target_ms)
            return max(lower, default=0)
        higher = (number for number in range(COUNT) if costs[number] <= ROOM * self.target_ms)
        return max(self.number, max(higher, default=0))


def check_number(number: int) -> int:
    """Return the number of a scale; raise UserError if there is no such scale."""
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < COUNT:
        raise UserError(f"There is no scale {number!r}: scales have the numbers 0 to {COUNT - 1}.")
    return number
