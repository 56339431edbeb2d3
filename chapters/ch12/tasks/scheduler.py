"""The task scheduler: tasks with names, dependencies, and the threads on which they may run.

    with Scheduler(workers=3, pinned=("io",)) as tasks:
        image = tasks.spawn("decode wall.png", lambda: decode(path), pin="io")
        cull = tasks.spawn("cull", lambda: visible_of(scene, view))
        record = tasks.spawn_range("record", record_draws, count=1000, after=[cull])
        tasks.wait(record)  # record_draws(first, last, thread) was called for every part of 0 to 999

The threads are those of the standard library's executors (`concurrent.futures`). This module adds dependencies between
tasks, ranges, waiting that runs other tasks meanwhile, and an index for every thread.

**Pools per thread.** A Vulkan pool, of commands or of descriptors, belongs to one thread at a time. So every thread
that runs tasks has a unique index from 0 to `threads` - 1: 0 is the thread that created the scheduler; then come the
workers, then the pinned threads. With one pool per index no lock is needed. (A task that waits may run other tasks on
top of itself, on its thread and with its index, as a function calls functions.)

**Overlap.** Python's interpreter lock lets one thread at a time run Python. C code that works for long without Python
objects releases the lock: Pillow while it decodes, zlib, reading files, hashing, compilers of shaders and pipelines,
numpy on large arrays. Such work overlaps. Python loops, short driver calls and numpy on small arrays do not: several
threads take as long as one, plus the time of switching. A Python without the lock (3.13t and later) overlaps all of it,
and this code stays the same: one lock protects the shared state.

**The end of tasks.** A task that raises has failed, and the tasks after it are cancelled; other tasks go on. `wait`
raises `TaskError` with the task's name, caused by the task's exception. Running tasks are not interrupted. When the
scheduler is closed (by the end of `with`, an exception or Ctrl-C), running tasks finish, tasks that have not begun are
cancelled, and all threads are joined.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from queue import Empty
from types import TracebackType
from typing import Any, TypeVar

from common.reports.profiling import Record

from .errors import TaskCancelledError, TaskError, error_from, error_of
from .graph import RangeWork, TaskGraph
from .order import Order, claim
from .pinned_loop import PinnedLoop
from .state import Failure, Post, State, Task, Thread, Wait

T = TypeVar("T")

_PATIENCE_S = 0.1 if os.name == "nt" else None
"""The longest sleep of a wait. On Windows Ctrl-C does not end the sleep, and is handled after it."""


def split(count: int, parts: int) -> list[tuple[int, int]]:
    """Return [first, last) of at most `parts` parts of [0, count), all of the same length or longer by one.

    None is empty. Raises ValueError for a negative count and for less than one part.
    """
    if count < 0 or parts < 1:
        raise ValueError(f"{count} indices in {parts} parts: there must be 0 or more in 1 or more")
    parts = min(parts, count)
    return [(count * part // parts, count * (part + 1) // parts) for part in range(parts)]


class Scheduler:
    """Runs tasks on `workers` threads, on one thread for each name in `pinned`, and in threads that wait.

    Without workers all tasks except pinned ones run inside `wait`, in the waiting thread, always in the same order. A
    waiting thread only runs tasks that it waits for: a frame that waits for its commands never decodes a file. So a
    task only runs tasks that it needs on top of itself, and spawning and waiting may be nested up to Python's stack
    limit, on any number of threads.

    The threads wait for work until the scheduler is closed: use `with`, or call `close` in a `finally`. Otherwise the
    program does not end.
    """

    def __init__(self, workers: int, pinned: Iterable[str] = (), trace: bool = False) -> None:
        """With `trace`, `records` tells when each task ran; it grows with every task. ValueError for bad threads."""
        names = list(pinned)
        if workers < 0 or len({*names}) < len(names):
            raise ValueError(f"{workers} workers and pinned threads {names}: not below 0, and each name once")
        self.threads = 1 + workers + len(names)
        """How many indices of threads there are: what a list of pools per thread needs."""
        self._hands = 1 + workers  # those that run what is pinned to none
        self.records: list[Record] | None = [] if trace else None
        """What ran: name, start and length in ns, depth on the thread, index of the thread; by end."""
        self._origin_ns = time.perf_counter_ns()
        self._unseen: dict[Failure, None] = {}  # errors that were not raised yet
        self._loops: list[PinnedLoop] = []
        self._closing = False
        self._here = threading.local()
        self._here.thread = self._owner = Thread(0)
        pins: list[str | None] = [*[None] * workers, *names]  # by index of the thread, from 1
        self._order = Order({pin: Post(pin) for pin in pins})
        self._lock = self._order.lock
        self._served = [self._order.posts[pin] for pin in pins]
        self._executor = ThreadPoolExecutor(max(1, len(self._served)))
        try:
            for index, post in enumerate(self._served, 1):
                self._executor.submit(self._serve, Thread(index, post.pin), post)
        except BaseException:
            self._shut_down()
            raise

    # --- what there is to do ------------------------------------------------------------------------------------------

    def spawn(
        self,
        name: str,
        work: Callable[[], T],
        *,
        after: Iterable[Task[Any]] = (),
        pin: str | None = None,
        priority: int = 0,
    ) -> Task[T]:
        """Add a task, which begins when all of `after` are done, and return at once. From any thread.

        `pin` names the pinned thread on which it must run; of tasks that could begin, those with the highest
        `priority` do.

        Raises:
            ValueError: there is no such pinned thread.
            TaskCancelledError: the scheduler is closed, or just being closed.
        """
        task = Task(name, lambda _: work(), tuple(after), pin, priority)
        self._add(task)
        return task

    def spawn_range(
        self,
        name: str,
        work: RangeWork,
        count: int,
        *,
        parts: int | None = None,
        after: Iterable[Task[Any]] = (),
        priority: int = 0,
    ) -> Task[None]:
        """Add a task over the indices [0, count): `work(first, last, thread)` gets each of them in exactly one part.

        There are `parts` parts, by default one for each thread that is not pinned, fewer where there are fewer
        indices. Once a part has failed no other begins; the range ends when all parts have ended. Raises as `spawn`
        and `split` do.
        """
        before = tuple(after)
        range_parts: list[Task[Any]] = []
        for first, last in split(count, self._hands if parts is None else parts):
            call = partial(_part, work, first, last)
            range_parts.append(
                Task(f"{name}[{first}:{last}]", call, before, priority=priority, parts=range_parts)
            )
        whole: Task[None] = Task(name, None, (*before, *range_parts), parts=range_parts)
        self._add(*range_parts, whole)
        return whole

    def join(self, name: str, after: Iterable[Task[Any]]) -> Task[None]:
        """Return a task without work: a name for the end of all of `after`. Raises as `spawn` does."""
        task: Task[None] = Task(name, None, tuple(after))
        self._add(task)
        return task

    def loop(self, name: str, step: Callable[[], bool], pin: str) -> PinnedLoop:
        """Let a pinned thread call `step` whenever it is woken, until it is stopped, see `PinnedLoop`.

        Nothing else runs on that thread meanwhile. Raises as `spawn` does.
        """
        loop = PinnedLoop(step)
        with self._lock:
            self._loops = [other for other in self._loops if other.execute] + [loop]
        loop.task = self.spawn(name, loop.run, pin=pin)
        return loop

    def start(self, graph: TaskGraph) -> dict[str, Task[Any]]:
        """Add all tasks of a graph; return them by name. Raises as `spawn` and `TaskGraph.ordered` do."""
        tasks: dict[str, Task[Any]] = {}
        for step in graph.ordered():
            tasks[step.name] = step.spawn(self, [tasks[name] for name in step.after])
        return tasks

    def run(self, graph: TaskGraph) -> dict[str, Any]:
        """Run a graph and wait for its end; return the results by name. Raises as `start` and `wait` do."""
        tasks = self.start(graph)
        self.wait(self.join(graph.name, tasks.values()))
        return {name: task.result for name, task in tasks.items()}

    def _add(self, *tasks: Task[Any]) -> None:
        with self._lock:
            for task in tasks:
                if self._closing:
                    raise TaskCancelledError(
                        f"Task {task.name!r} cannot begin: its scheduler is closed.", task.name
                    )
                if task.pin is not None and task.pin not in self._order.posts:
                    raise ValueError(f"task {task.name!r} is pinned to {task.pin!r}: no thread is called so")
                self._order.add(task)

    # --- threads at work ----------------------------------------------------------------------------------------------

    def _serve(self, thread: Thread, post: Post) -> None:
        """Be one of the threads: run the tasks of a post, until the scheduler is closed."""
        self._here.thread = thread
        threading.current_thread().name = thread.pin or f"worker {thread.index}"
        while post.wake.get():
            with self._lock:
                task = claim(post.ready, thread)
            if task is not None:  # else a thread that helps was faster
                self._run(task, thread)

    def _run(self, task: Task[Any], thread: Thread) -> None:
        """Do the work of a task that this thread has claimed, and end it."""
        depth, call = len(thread.stack), task.call
        assert call is not None
        failure: Failure | None = None
        interrupt: BaseException | None = None
        start_ns = time.perf_counter_ns()
        try:
            thread.stack.append(task)
            task.outcome = call(thread.index)
        except TaskCancelledError:
            failure = Failure(task.name)  # it waited for something that was cancelled
        except Exception as error:
            failure = Failure(task.name, error)
        except BaseException as error:
            # Ctrl-C is for the thread that created the scheduler: in another thread it would go unnoticed.
            interrupt = error if thread is self._owner else None
            failure = Failure(task.name, None if interrupt else error)
        finally:
            del thread.stack[depth:]
        end_ns = time.perf_counter_ns()
        with self._lock:
            if self.records is not None:
                start = start_ns - self._origin_ns
                self.records.append(Record(task.name, start, end_ns - start_ns, depth, thread.index))
            if failure is not None:
                task.failures.append(failure)
                if failure.error is not None:
                    self._unseen[failure] = None
                for other in task.parts:
                    self._order.give_up(other, failure)
            self._order.advance(task)
        if interrupt is not None:
            raise interrupt

    def wait(self, task: Task[T]) -> T:
        """Return the result of a task when it has ended; run what it needs meanwhile.

        When this returns or raises, all that the task comes after has ended, too. To be called by a thread with an
        index, in a task or outside.

        Raises:
            TaskError: it failed or could not run, because another failed; of several errors the first is the cause,
                the others are notes.
            TaskCancelledError: it was cancelled, or what it comes after was.
            RuntimeError: the wait would never end, since `task` needs the task that is waiting; or this thread is
                none of the scheduler's.
        """
        thread = self._current()
        waiting = thread.stack[-1] if thread.stack else None
        wait = Wait(thread.pin, target=task)
        try:
            with self._lock:
                self._order.begin_wait(wait, waiting)
            while (ready := self._next_for(wait, thread)) is not None:
                self._run(ready, thread)
        finally:
            with self._lock:
                self._order.end_wait(wait, waiting)
        if task.failures:
            with self._lock:
                for failure in task.failures:
                    self._unseen.pop(failure, None)
            raise error_of(task)
        return task.result

    def _next_for(self, wait: Wait, thread: Thread) -> Task[Any] | None:
        """Return a task to help with, or None when the wait is over; sleep until there is either."""
        while True:
            with self._lock:
                if wait.target.ended:
                    return None
                task = claim(wait.ready, thread)
            if task is not None:
                return task
            with suppress(Empty):
                wait.wake.get(timeout=_PATIENCE_S)

    @property
    def thread(self) -> int:
        """The index of the thread that asks; RuntimeError if it is none of the scheduler's."""
        return self._current().index

    def _current(self) -> Thread:
        thread: Thread | None = getattr(self._here, "thread", None)
        if thread is None:
            name = threading.current_thread().name
            raise RuntimeError(f"the thread {name!r} is none of the scheduler's, and has no index")
        return thread

    # --- the end ------------------------------------------------------------------------------------------------------

    def cancel(self, task: Task[Any]) -> bool:
        """Cancel a task, or all parts of a range that have not begun; return whether that kept it from being done.

        What comes after it is cancelled with it, what it comes after is not. Nothing interrupts what runs; work that
        takes long may ask `stopping` now and then.
        """
        with self._lock:
            failure = Failure(task.name)
            for part in (*task.parts, task):
                self._order.give_up(part, failure)
            return task.state in (State.WAITING, State.CANCELLED)

    @property
    def stopping(self) -> bool:
        """Whether the scheduler is being closed: a task that takes long may end early."""
        return self._closing

    def check(self) -> None:
        """Raise TaskError for failed tasks that were not waited for; it is raised once."""
        with self._lock:
            faults = list(self._unseen)
            self._unseen.clear()
        if faults:
            raise error_from(f"Task {faults[0].name!r} failed", faults)

    def close(self) -> None:
        """Cancel what has not begun, stop loops, wait for what runs, join all threads; again: do nothing.

        Raises:
            TaskError: as `check` does.
            RuntimeError: another thread than the one that made the scheduler asks, or a task does.
        """
        if self._current() is not self._owner or self._owner.stack:
            raise RuntimeError("a scheduler is closed by the thread that made it, outside of its tasks")
        try:
            self._shut_down()
        except KeyboardInterrupt:
            self._shut_down()  # impatience does not leave threads behind, a second time does
            raise
        self.check()

    def _shut_down(self) -> None:
        with self._lock:
            self._closing = True
            self._order.give_up_all(self._owner)
        for loop in self._loops:
            loop.stop()
        for post in self._served:
            post.wake.put(False)
        self._executor.shutdown()

    def __enter__(self) -> Scheduler:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except TaskError as unseen:
            if error is None:
                raise
            error.add_note(str(unseen))


def _part(work: RangeWork, first: int, last: int, thread: int) -> None:
    work(first, last, thread)
