"""A loop with a thread for itself, such as the one that loads files: it sleeps until it is woken.

Whoever gives it something to do wakes it, and whoever closes the scheduler stops it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from .task_state import Task


class PinnedLoop:
    """Calls `step` again and again on a pinned thread; `Scheduler.loop` makes one.

    A loop that asked in every round whether there is something to do would take a core from those who have. This one
    sleeps on a condition: `wake` after giving it something to do, `stop` for its end.
    """

    task: Task[Any]
    """The loop as a task: `Scheduler.wait` waits for its end, and raises what `step` raised."""

    def __init__(self, step: Callable[[], bool]) -> None:
        """`step` does a piece of work and returns whether it should be called again at once."""
        self._step = step
        self._lock = threading.Lock()
        self._signal = threading.Condition(self._lock)
        self._woken = False
        self.execute = True
        """Whether the loop goes on."""

    def wake(self) -> None:
        """Have `step` called soon, and once more if it is being called just now. From any thread."""
        with self._lock:
            self._woken = True
            self._signal.notify()

    def stop(self) -> None:
        """Let the loop end when `step` returns, or before it begins. Returns at once; from any thread."""
        with self._lock:
            self.execute = False
            self._signal.notify()

    def run(self) -> None:
        """Be the loop, until it is stopped or `step` raises."""
        try:
            while self._sleep():
                while self.execute and self._step():
                    pass
        finally:
            self.execute = False

    def _sleep(self) -> bool:
        """Return when woken: True to work, False to end."""
        with self._lock:
            self._signal.wait_for(lambda: self._woken or not self.execute)
            self._woken = False
            return self.execute
