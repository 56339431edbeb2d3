"""What the command line says and how: results on stdout, the rest on stderr, progress only where it takes time."""

from __future__ import annotations

import io
import os
import sys
import threading
import time
from contextlib import ExitStack
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from common.errors import UserError
from common.names import visible
from common.reports import waiting

PATIENCE_S = 0.8
"""A bar appears when something has taken this long."""

WIDTHS = (60, 400)
"""The least and the most columns that tables and help are laid out for, whatever the terminal or COLUMNS says."""

READER_GONE = 141
"""The exit code where nobody reads on, as in `strata list | head -1`: 128 and the number of SIGPIPE."""


# Nothing here is written as :name: to become a picture, and code, paths and what files hold is to be seen as it is.
class _Console(Console):
    """Prints what is visible of a text, and of what steers a terminal its escapes; lines and tabs stay."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Return the text that stands for a string, in a table's cell as well."""
        return super().render_str(shown(text), **options)


out = _Console(highlight=False, emoji=False)
err = _Console(stderr=True, highlight=False, emoji=False)


def say(text: str) -> None:
    """Tell the user something beside the result; the text is taken as it is."""
    err.print(text, markup=False, soft_wrap=True)


def quoted(text: str) -> str:
    """Return a folder's name as it is typed in a command."""
    return f'"{text}"' if " " in text else text


def shown(text: str) -> str:
    """Return what is printed for `text`: its lines and tabs, and the rest as `common.names.visible` has it."""
    return visible(text, keep="\n\t")


class _ClosedStdout(io.TextIOBase):
    """Takes the place of a stdout that the caller closed, as by `>&-`: who prints to it is told."""

    def write(self, text: str) -> int:
        raise UserError("The result cannot be printed: stdout is closed.")


def prepare() -> None:
    """Make the streams and the width of the terminal usable, and let long waits be told there."""
    waiting.listeners[:] = [lambda text: say(f"strata: {text}")]
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # else the next file that any library opens would get all that is printed
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    if sys.stdout is None:
        sys.stdout = _ClosedStdout()
    elif isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")
    found = Console().width
    bounded = min(max(found, WIDTHS[0]), WIDTHS[1])
    if bounded != found:
        os.environ["COLUMNS"] = str(bounded)  # for the help, which has a console of its own
        out.width = err.width = bounded


class Steps:
    """A progress bar over the steps of one command, shown only if it takes longer than `PATIENCE_S`.

        with Steps() as steps:
            scene = load_scene(path, steps.of("loading", 0.0, 0.5))
            steps("compiling shaders", 0.5)

    At a terminal it is a bar that disappears; elsewhere a line names each step that takes longer than
    `waiting.PATIENCE_S`, and nothing else is printed. `enabled=False` prints nothing anywhere.
    """

    def __init__(self, enabled: bool | None = None) -> None:
        self._enabled = err.is_terminal if enabled is None else enabled
        self._lines = enabled is None and not self._enabled
        self._waiting = ExitStack()
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
        self._waiting.close()
        if self._lines:
            self._waiting.enter_context(waiting.told(lambda: f"still busy with this step: {what}."))

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
        self._waiting.close()
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


def reader_is_gone(error: BaseException | None) -> bool:
    """Whether `error` says that the reader of our output went away: no fault of anybody's.

    Then what is still to be printed is dropped.
    """
    if not isinstance(error, BrokenPipeError):
        return False
    drop_output()
    return True


def drop_output() -> None:
    """Let stdout lead nowhere from now on: what it could not take would fail once more at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno() if sys.__stdout__ else 1)
