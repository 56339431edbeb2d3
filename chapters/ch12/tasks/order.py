"""The order of tasks: which of them can begin, which can no longer succeed, and which threads wait for them."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Mapping
from heapq import heappop
from typing import Any

from .state import Failure, Heap, Post, State, Task, Thread, Wait


class Order:
    """The tasks that have not ended, the waits that are not over, and the posts where tasks are offered.

    All of it is shared by all threads: every method is to be called with `lock` held.
    """

    def __init__(self, posts: Mapping[str | None, Post]) -> None:
        """`posts` by the name of the pinned thread, None for the workers."""
        self.lock = threading.Lock()
        self.posts = posts
        self.live: dict[Task[Any], None] = {}
        """What has not ended, in the order of making: nothing stands before what it comes after."""
        self._waits: list[Wait] = []
        self._numbers = itertools.count()

    def add(self, task: Task[Any]) -> None:
        """Take in a new task, and let it begin if nothing keeps it."""
        task.number = next(self._numbers)
        self.live[task] = None
        for before in task.after:
            if before.ended:
                _inherit(task, before)
            else:
                before.dependents.append(task)
                task.unmet += 1
        if task.unmet == 0:
            self.advance(task)

    def advance(self, task: Task[Any]) -> None:
        """Let a task begin for which nothing is left to wait, or end it if it has run or cannot end well.

        With its end others can begin or end; one after the other, so that a long chain needs no deep stack.
        """
        open_ = deque([task])
        while open_:
            task = open_.popleft()
            if not (task.begun or task.failures or task.joins):
                self._make_ready(task)
                continue
            failed = (task.begun or task.joins) and any(failure.error for failure in task.failures)
            task.state = State.FAILED if failed else State.CANCELLED if task.failures else State.DONE
            self.live.pop(task, None)
            for wait in self._waits:
                if wait.target is task:
                    wait.wake.put(True)
            for later in task.dependents:
                _inherit(later, task)
                later.unmet -= 1
                if later.unmet == 0:
                    open_.append(later)
            # A task that is kept for its result must not keep its inputs, nor the tasks of old frames.
            task.call, task.after, task.dependents, task.parts = None, (), [], []

    def _make_ready(self, task: Task[Any]) -> None:
        task.state = State.READY
        for wait in self._waits:
            wait.can_begin(task)
        if task.pin in self.posts:
            self.posts[task.pin].offer(task)

    def give_up(self, task: Task[Any], failure: Failure) -> None:
        """Cancel a task if it has not begun; it ends when all that it comes after has."""
        if not task.begun:
            task.failures.append(failure)
            if task.unmet == 0:
                self.advance(task)

    def give_up_all(self, owner: Thread) -> None:
        """Cancel all that has not begun. `owner` is the thread that asks, and runs none of them.

        Ctrl-C may have come between any two steps of that thread: a task that it claimed never ran, or one that ended
        has not told those that come after it. So nothing that was counted before is believed.
        """
        for task in list(self.live):
            task.unmet = sum(not before.ended for before in task.after)
            if task.state is State.RUNNING and task.thread == owner.index:
                task.failures.append(Failure(task.name))
                self.advance(task)
            else:
                self.give_up(task, Failure(task.name))

    def begin_wait(self, wait: Wait, waiting: Task[Any] | None) -> None:
        """Offer to `wait` what it needs; `waiting` is the task that waits.

        Raises:
            RuntimeError: the wait would never end, since what it needs needs the task that waits.
        """
        needed = _needed_for(wait.target)
        if waiting is not None:
            if waiting in needed:
                path = " -> ".join([*_path_from(waiting, needed), waiting.name])
                raise RuntimeError(
                    f"task {waiting.name!r} waits for {wait.target.name!r}, which would never end: "
                    f"each comes before the next in {path}"
                )
            waiting.waits_for = wait.target
            for other in self._waits:
                if waiting in other.needed:
                    other.need(needed)
        wait.need(needed)
        self._waits.append(wait)

    def end_wait(self, wait: Wait, waiting: Task[Any] | None) -> None:
        """Offer nothing more to `wait`."""
        self._waits = [other for other in self._waits if other is not wait]
        if waiting is not None:
            waiting.waits_for = None


def _inherit(task: Task[Any], before: Task[Any]) -> None:
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


def _needed_for(task: Task[Any]) -> dict[Task[Any], Task[Any] | None]:
    """Return all that has to end before a task has, itself included, each with one that needs it. Under the lock."""
    if task.ended:
        return {}
    needed: dict[Task[Any], Task[Any] | None] = {task: None}
    open_ = [task]
    while open_:
        task = open_.pop()
        for below in (*task.after, *((task.waits_for,) if task.waits_for else ())):
            if not below.ended and below not in needed:
                needed[below] = task
                open_.append(below)
    return needed


def _path_from(task: Task[Any], needed: Mapping[Task[Any], Task[Any] | None]) -> list[str]:
    """Return the names that lead from a task to the one that `needed` was made for."""
    names = []
    step: Task[Any] | None = task
    while step is not None:
        names.append(step.name)
        step = needed[step]
    return names
