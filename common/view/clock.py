"""Time as frames see it: a clock that never goes back, and updates at a fixed interval that do not depend on frames."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

NS_PER_S = 1_000_000_000
DEFAULT_STEP_NS = 10_000_000
DEFAULT_MAX_STEPS = 10


@dataclass(frozen=True)
class Duration:
    """A length of time in whole nanoseconds; the properties are the nearest floats."""

    ns: int

    @property
    def s(self) -> float:
        """Seconds."""
        return self.ns / NS_PER_S

    @property
    def ms(self) -> float:
        """Milliseconds."""
        return self.ns / 1_000_000

    @property
    def us(self) -> float:
        """Microseconds."""
        return self.ns / 1_000


@dataclass(frozen=True)
class Tick:
    """One frame's time: its number, the time since the clock began, and since the frame before."""

    frame: int
    time: Duration
    delta: Duration


class FrameClock:
    """Gives every frame a time later than the last one's, whatever the timer does."""

    def __init__(self, timer_ns: Callable[[], int] = time.perf_counter_ns) -> None:
        """`timer_ns` returns nanoseconds since any moment."""
        self._timer = timer_ns
        self._last = timer_ns()
        self._elapsed = 0
        self._frame = 0

    def tick(self) -> Tick:
        """Begin a frame. Its delta is at least 1 ns: a timer may stand still, and rates divide by it."""
        now = self._timer()
        delta = max(now - self._last, 1)
        self._last = max(now, self._last)
        self._elapsed += delta
        tick = Tick(self._frame, Duration(self._elapsed), Duration(delta))
        self._frame += 1
        return tick


class FixedStep:
    """Counts updates of a fixed length: as many as time has passed, however many frames that took.

    After a long pause at most `max_steps` are made up for in one frame and the rest of the pause is forgotten: a
    simulation slower than real time would otherwise fall further behind with every frame.
    """

    def __init__(self, step_ns: int = DEFAULT_STEP_NS, max_steps: int = DEFAULT_MAX_STEPS) -> None:
        if step_ns <= 0 or max_steps < 1:
            raise ValueError(f"a step of {step_ns} ns, at most {max_steps} at once: both must be positive")
        self.step = Duration(step_ns)
        self.max_steps = max_steps
        self._owed_ns = 0

    def advance(self, delta: Duration) -> int:
        """Return how many steps are due after `delta` more time; what is less than a step is kept."""
        self._owed_ns += max(delta.ns, 0)
        steps, self._owed_ns = divmod(self._owed_ns, self.step.ns)
        return min(steps, self.max_steps)

    @property
    def fraction(self) -> float:
        """The part of a step, 0 to 1, that has passed since the last one: what a picture between two blends by."""
        return self._owed_ns / self.step.ns
