"""What the command line says and how: results on stdout, the rest on stderr, progress only where it takes time."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

PATIENCE_S = 0.8
"""A bar appears when something has taken this long."""

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def say(text: str) -> None:
    """Tell the user something beside the result; the text is taken as it is."""
    err.print(text, markup=False, soft_wrap=True)


class Steps:
    """A progress bar over the steps of one command, shown only if it takes longer than `PATIENCE_S`.

        with Steps() as steps:
            scene = load_scene(path, steps.of("loading", 0.0, 0.5))
            steps("compiling shaders", 0.5)

    At a terminal it is a bar that disappears; elsewhere nothing is printed.
    """

    def __init__(self, enabled: bool | None = None) -> None:
        self._enabled = err.is_terminal if enabled is None else enabled
        self._progress: Progress | None = None
        self._lock = threading.Lock()
        self._what, self._part = "", 0.0
        self._timer = threading.Timer(PATIENCE_S, self._show)
        self._timer.daemon = True
        self.times: dict[str, float] = {}
        self._began = time.perf_counter()

    def __enter__(self) -> Steps:
        if self._enabled:
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def __call__(self, what: str, part: float) -> None:
        """Say what is being done now, and which part of the whole is behind."""
        with self._lock:
            now = time.perf_counter()
            if self._what:
                self.times[self._what] = self.times.get(self._what, 0.0) + now - self._began
            self._began = now
            self._what, self._part = what, part
            self._update()

    def of(self, what: str, begin: float, end: float) -> object:
        """Return a callback (part from 0 to 1, what) for a step that reports its own progress."""
        self(what, begin)

        def advance(part: float, detail: str) -> None:
            with self._lock:
                self._part = begin + (end - begin) * part
                self._update(detail)

        return advance

    def finish(self) -> None:
        """Take the bar away; its steps' times in seconds stay in `times`."""
        self._timer.cancel()
        with self._lock:
            if self._what:
                self.times[self._what] = self.times.get(self._what, 0.0) + time.perf_counter() - self._began
                self._what = ""
            if self._progress is not None:
                self._progress.stop()
                self._progress = None
            self._enabled = False

    def _show(self) -> None:
        with self._lock:
            if not self._enabled:
                return
            self._progress = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TimeElapsedColumn(),
                console=err,
                transient=True,
            )
            self._progress.add_task(self._what, total=1.0)
            self._update()
            self._progress.start()

    def _update(self, detail: str = "") -> None:
        if self._progress is not None and self._progress.task_ids:
            description = f"{self._what}: {detail}" if detail and detail != self._what else self._what
            self._progress.update(self._progress.task_ids[0], description=description, completed=self._part)


def stdout_is_closed(error: BaseException) -> bool:
    """Whether the reader of our output went away, as in `strata list | head -1`: no fault of anybody's."""
    if not isinstance(error, BrokenPipeError):
        return False
    # Python would fail once more when it flushes at exit.
    import os

    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return True
