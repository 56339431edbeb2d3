"""A loop with a thread for itself, such as the one that loads files: it sleeps until it is woken.

A thread that gives it work wakes it; closing the scheduler stops it.
"""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from .state import Task


class PinnedLoop:
    """Calls `step` again and again on a pinned thread; `Scheduler.loop` makes one.

    A loop that polls for work would take a core from threads that have work. This one sleeps in the `get` of a queue:
    call `wake` after giving it work, `stop` to end it.
    """

    task: Task[Any]
    """The loop as a task: `Scheduler.wait` waits for its end, and raises what `step` raised."""

    def __init__(self, step: Callable[[], bool]) -> None:
        """`step` does a piece of work and returns whether it should be called again at once."""
        self._step = step
        self._wakes: SimpleQueue[None] = SimpleQueue()
        self.execute = True
        """Whether the loop goes on."""

    def wake(self) -> None:
        """Have `step` called soon, and once more if it is being called just now. From any thread."""
        self._wakes.put(None)

    def stop(self) -> None:
        """Let the loop end when `step` returns, or before it begins. Returns at once; from any thread."""
        self.execute = False
        self._wakes.put(None)

    def run(self) -> None:
        """Be the loop, until it is stopped or `step` raises."""
        try:
            while self.execute:
                self._wakes.get()
                while self.execute and self._step():
                    pass
        finally:
            self.execute = False
