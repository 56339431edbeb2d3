"""The worker threads of one renderer: they start with the first task, and end when the renderer is closed."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from .errors import TaskError
from .graph import RangeWork
from .scheduler import Scheduler

ALONE = {"recording_threads": 1, "recorded_parts": 0}
"""What a frame counts that no other thread had a part in."""


class Workers:
    """A scheduler that is opened at its first use, by the thread that uses it, and closed by the same one.

    A renderer that never asks for it starts no thread.
    """

    def __init__(self, count: int, pinned: Iterable[str] = ()) -> None:
        """See `Scheduler` for both."""
        self.count = count
        self._pinned = tuple(pinned)
        self._tasks: Scheduler | None = None
        self._closed = False

    @property
    def tasks(self) -> Scheduler:
        """The scheduler; RuntimeError when it was closed."""
        if self._closed:
            raise RuntimeError("the threads of this renderer have ended, since it was closed")
        if self._tasks is None:
            self._tasks = Scheduler(self.count, self._pinned)
        return self._tasks

    def share(self, name: str, work: RangeWork, count: int, parts: int) -> None:
        """Do `work(first, last, thread)` for [0, count) in parts, by all workers and this thread; return when done.

        When this raises nothing of it runs any more, also after Ctrl-C: what the parts use may be used again.
        Raises TaskError if a part has failed.
        """
        task = self.tasks.spawn_range(name, work, count, parts=parts)
        try:
            self.tasks.wait(task)
        except KeyboardInterrupt:
            self.tasks.cancel(task)
            with suppress(TaskError):
                self.tasks.wait(task)
            raise

    def close(self) -> None:
        """End the threads; a second time does nothing. Raises as `Scheduler.close` does, after they have ended."""
        tasks, self._tasks, self._closed = self._tasks, None, True
        if tasks is not None:
            tasks.close()
