"""A task while it waits, runs and ends, a thread that runs tasks, and a thread that waits for one.

All of it is the scheduler's, which changes it under its lock.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from heapq import heappop, heappush
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


class State(Enum):
    """How far a task is. The last three are ends: nothing leads out of them."""

    WAITING = "waits for others"
    READY = "can begin"
    RUNNING = "runs"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, eq=False)
class Failure:
    """Why something did not end well: the task `name` raised `error`, or was cancelled (None)."""

    name: str
    error: BaseException | None = None


@dataclass(eq=False)
class Task(Generic[T]):
    """One run of some work. `name` and `state` are for everyone to read; all else is the scheduler's, under its lock.

    `call` gets the index of the thread. A task without one ends by itself when the last of `after` has ended.
    """

    name: str
    call: Callable[[int], T] | None
    after: tuple[Task[Any], ...] = ()
    pin: str | None = None
    priority: int = 0
    number: int = 0
    """The order of their making."""
    state: State = State.WAITING
    outcome: T | None = None
    failures: list[Failure] = field(default_factory=list)
    """Why it cannot end well, by time: its own fault, or one of those that it comes after."""
    dependents: list[Task[Any]] = field(default_factory=list)
    unmet: int = 0
    """How many of `after` have not ended."""
    parts: list[Task[Any]] = field(default_factory=list)
    """All parts of the same range; cancelled together."""
    waits_for: Task[Any] | None = None
    """What it waits for while it runs."""
    thread: int | None = None
    """The index of the thread that runs it."""
    joins: bool = field(init=False)
    """Whether it has no work of its own."""

    def __post_init__(self) -> None:
        self.joins = self.call is None

    @property
    def ended(self) -> bool:
        """Whether it is done, failed or cancelled, and with it all that it comes after."""
        return self.state in (State.DONE, State.FAILED, State.CANCELLED)

    @property
    def begun(self) -> bool:
        """Whether it runs or has ended."""
        return self.state not in (State.WAITING, State.READY)

    @property
    def place(self) -> tuple[int, int, Task[T]]:
        """What a heap of tasks sorts: the highest priority first, then the oldest."""
        return -self.priority, self.number, self

    @property
    def result(self) -> T:
        """What the work of a task that is done has returned; raises ValueError as long as it is not."""
        if self.state is not State.DONE:
            raise ValueError(f"task {self.name!r} has no result: its state is {self.state.name}")
        return cast(T, self.outcome)


Heap = list[tuple[int, int, Task[Any]]]
"""Tasks that can begin, by `Task.place`. One that another thread has taken meanwhile is passed over."""


@dataclass(eq=False)
class Thread:
    """A thread that runs tasks. `stack` are those that it runs: each but the last waits for something above it."""

    index: int
    pin: str | None = None
    stack: list[Task[Any]] = field(default_factory=list)


@dataclass(eq=False)
class Wait:
    """A thread that waits for `target`. It runs tasks of `needed`, and no others."""

    target: Task[Any]
    pin: str | None
    wake: threading.Condition
    needed: set[Task[Any]] = field(default_factory=set)
    ready: Heap = field(default_factory=list)

    def need(self, tasks: Iterable[Task[Any]]) -> None:
        """Help with these tasks, too."""
        for task in tasks:
            if task not in self.needed:
                self.needed.add(task)
                if task.state is State.READY:
                    self.offer(task)

    def offer(self, task: Task[Any]) -> None:
        """Tell the thread of a task that can begin, if it may run it."""
        if task.pin in (None, self.pin):
            heappush(self.ready, task.place)
            self.wake.notify()


def inherit(task: Task[Any], before: Task[Any]) -> None:
    """Let a task fail for what a task before it failed for."""
    task.failures.extend(failure for failure in before.failures if failure not in task.failures)


def claim(heap: Heap, thread: Thread) -> Task[Any] | None:
    """Take the first task that can still begin; from then on it runs in this thread. Under the lock."""
    while heap:
        task = heappop(heap)[-1]
        if task.state is State.READY:
            task.state, task.thread = State.RUNNING, thread.index
            return task
    return None


def needed_for(task: Task[Any]) -> dict[Task[Any], Task[Any] | None]:
    """Return all that has to end before a task has, itself included, each with one that needs it. Under the lock."""
    if task.ended:
        return {}
    needed: dict[Task[Any], Task[Any] | None] = {task: None}
    open_ = [task]
    while open_:
        one = open_.pop()
        for below in (*one.after, *((one.waits_for,) if one.waits_for else ())):
            if not below.ended and below not in needed:
                needed[below] = one
                open_.append(below)
    return needed


def path_from(task: Task[Any], needed: Mapping[Task[Any], Task[Any] | None]) -> list[str]:
    """Return the names that lead from a task to the one that `needed` was made for."""
    names = []
    step: Task[Any] | None = task
    while step is not None:
        names.append(step.name)
        step = needed[step]
    return names
