"""A task while it waits, runs and ends, a thread that runs tasks, and a thread that waits for one.

All of it is the scheduler's, which changes it under its lock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum
from heapq import heappush
from queue import SimpleQueue
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
    """One run of some work. Any thread may read `name` and `state`; all else belongs to the scheduler, under its lock.

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
class Post:
    """Where threads wait for tasks: those that can begin, and an entry in `wake` for each of them (False: the end).

    A queue, not a condition: Ctrl-C between two steps of Python's `Condition` would leave its lock in disorder, while
    putting and getting are one step each.
    """

    pin: str | None = None
    ready: Heap = field(default_factory=list)
    wake: SimpleQueue[bool] = field(default_factory=SimpleQueue)

    def offer(self, task: Task[Any]) -> None:
        """Have a thread run a task that can begin."""
        heappush(self.ready, task.place)
        self.wake.put(True)


@dataclass(eq=False, kw_only=True)
class Wait(Post):
    """The post of one thread, which waits for `target`. It runs tasks of `needed` meanwhile, and no others."""

    target: Task[Any]
    needed: set[Task[Any]] = field(default_factory=set)

    def need(self, tasks: Iterable[Task[Any]]) -> None:
        """Help with these tasks, too."""
        new = [task for task in tasks if task not in self.needed]
        self.needed.update(new)
        for task in new:
            if task.state is State.READY:
                self.can_begin(task)

    def can_begin(self, task: Task[Any]) -> None:
        """Offer a task to the thread that waits, if it helps to the end of the wait and may run there."""
        if task in self.needed and task.pin in (None, self.pin):
            self.offer(task)
