"""The threads of one renderer: they start when somebody first has tasks for them, and end when it is closed."""

from __future__ import annotations

from collections.abc import Iterable

from .tasks import Scheduler


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

    @property
    def started(self) -> bool:
        """Whether there are threads."""
        return self._tasks is not None

    def close(self) -> None:
        """End the threads; a second time does nothing. Raises as `Scheduler.close` does, after they have ended."""
        tasks, self._tasks, self._closed = self._tasks, None, True
        if tasks is not None:
            tasks.close()
