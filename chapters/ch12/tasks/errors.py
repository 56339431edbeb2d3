"""The errors that tell how a task ended: which one failed, for what, and what did not run because of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from common.errors import StrataError

from .state import Failure, Task


class TaskError(StrataError):
    """A task failed. `name` says which; what it raised, with its traceback, is the `__cause__`."""

    def __init__(self, text: str, name: str, cause: BaseException | None = None) -> None:
        super().__init__(text)
        self.name = name
        self.__cause__ = cause
        if isinstance(cause, StrataError):
            self.exit_code = cause.exit_code  # a wrong file is the user's, on whichever thread it is read


class TaskCancelledError(TaskError):
    """A task did not run, because it or something that it comes after was cancelled."""


NOTED = 8
"""How many further failures an error tells of."""


def error_of(task: Task[Any]) -> TaskError:
    """Return what to raise for a task that did not end well: the first error, with notes on further ones."""
    faults = [failure for failure in task.failures if failure.error is not None]
    if not faults:
        name = task.failures[0].name
        return TaskCancelledError(
            f"Task {task.name!r} was cancelled" + (f" with {name!r}." if name != task.name else "."), name
        )
    first = faults[0].name
    if first == task.name:
        how = "failed"
    elif task.joins:
        how = f"failed in {first!r}"
    else:
        how = f"did not run, because {first!r} failed"
    return error_from(f"Task {task.name!r} {how}", faults)


def error_from(text: str, faults: Sequence[Failure]) -> TaskError:
    """Return an error that begins with `text` and is caused by the first fault, with notes on the others."""
    first, *others = faults
    error = TaskError(f"{text}: {_told(first)}", first.name, first.error)
    for other in others[:NOTED]:
        error.add_note(f"Task {other.name!r} failed, too: {_told(other)}")
    if len(others) > NOTED:
        error.add_note(f"So did {len(others) - NOTED} more.")
    return error


def _told(failure: Failure) -> str:
    error = failure.error
    text = str(error) if isinstance(error, StrataError) else f"{type(error).__name__}: {error}"
    return text.rstrip(".") + "."
