"""Where the CPU's time goes: nested blocks by name behind a switch, captures in a file, and frames per second.

    with profiling.block("culling"):
        ...

costs one call while nothing records. `profiling.use(BlockProfiler())` turns recording on; call sites
do not change. A capture is written in Chrome's trace format, which Perfetto and chrome://tracing show as a flame graph.
"""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

from common.errors import UserError
from common.paths import write_whole


@dataclass(frozen=True)
class Record:
    """A block that has ended. `start_ns` counts from the profiler's beginning, `thread` in the order of first use."""

    name: str
    start_ns: int
    duration_ns: int
    depth: int
    thread: int

    @property
    def end_ns(self) -> int:
        """When it ended."""
        return self.start_ns + self.duration_ns


class Profiler(Protocol):
    """What call sites see of a backend."""

    def push(self, name: str) -> None:
        """Begin a block inside the one that is open in this thread."""
        ...

    def pop(self) -> None:
        """End the innermost open block of this thread; raises UnbalancedError where none is open."""
        ...

    def block(self, name: str) -> AbstractContextManager[None]:
        """Return a context that is a block."""
        ...

    def records(self) -> list[Record]:
        """Return the blocks that have ended, parents before children."""
        ...


class UnbalancedError(RuntimeError):
    """A block was ended that was never begun, or a capture was asked for while one is open."""


class NullProfiler:
    """Records nothing."""

    _nothing = nullcontext()

    def push(self, name: str) -> None:
        """Do nothing."""

    def pop(self) -> None:
        """Do nothing."""

    def block(self, name: str) -> AbstractContextManager[None]:
        """Return a context that does nothing."""
        return self._nothing

    def records(self) -> list[Record]:
        """Return no records."""
        return []


class BlockProfiler:
    """Records blocks; every thread has a stack of its own."""

    def __init__(self, timer_ns: Callable[[], int] = time.perf_counter_ns) -> None:
        self._timer = timer_ns
        self._origin = timer_ns()
        self._lock = threading.Lock()
        self._stacks: dict[int, list[tuple[str, int, int]]] = {}
        self._threads: dict[int, int] = {}
        self._order = itertools.count()
        self._records: list[tuple[int, Record]] = []

    def push(self, name: str) -> None:
        """Begin a block inside the one that is open in this thread."""
        thread = threading.get_ident()
        stack = self._stacks.get(thread)
        if stack is None:
            with self._lock:
                stack = self._stacks[thread] = []
                self._threads[thread] = len(self._threads)
        stack.append((name, next(self._order), self._timer() - self._origin))

    def pop(self) -> None:
        """End the innermost open block of this thread.

        Raises:
            UnbalancedError: none is open.
        """
        now = self._timer() - self._origin
        thread = threading.get_ident()
        stack = self._stacks.get(thread)
        if not stack:
            raise UnbalancedError("a block was ended that was never begun in this thread")
        name, order, start = stack.pop()
        record = Record(name, start, now - start, len(stack), self._threads[thread])
        self._records.append((order, record))

    def block(self, name: str) -> AbstractContextManager[None]:
        """Return a context that is a block; it ends when an exception passes, too."""
        return _Block(self, name)

    def records(self) -> list[Record]:
        """Return the blocks that have ended, by thread and in the order of their beginning: parents before children."""
        return [record for _, record in sorted(self._records, key=lambda pair: (pair[1].thread, pair[0]))]

    def save(self, path: Path) -> None:
        """Write all records as a capture.

        Raises:
            UnbalancedError: a block is still open, so its children would have no parent.
            UserError: the file cannot be written.
        """
        still_open = [stack[-1][0] for stack in self._stacks.values() if stack]
        if still_open:
            raise UnbalancedError(f"the block {still_open[0]!r} is still open")
        events = [
            {
                "name": record.name,
                "ph": "X",
                "pid": 0,
                "tid": record.thread,
                "ts": record.start_ns / 1000,  # the format counts in microseconds
                "dur": record.duration_ns / 1000,
                "args": {"depth": record.depth},
            }
            for record in self.records()
        ]
        try:
            write_whole(path, json.dumps({"traceEvents": events, "displayTimeUnit": "ns"}).encode())
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror or error}") from None


class _Block:
    def __init__(self, profiler: BlockProfiler, name: str) -> None:
        self._profiler = profiler
        self._name = name

    def __enter__(self) -> None:
        self._profiler.push(self._name)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._profiler.pop()


def load_capture(path: Path) -> list[Record]:
    """Return the records of a capture that `save` wrote.

    Raises:
        UserError: the file is missing or is no such capture.
    """
    try:
        return [
            Record(
                str(event["name"]),
                round(event["ts"] * 1000),
                round(event["dur"] * 1000),
                int(event["args"]["depth"]),
                int(event["tid"]),
            )
            for event in json.loads(path.read_bytes())["traceEvents"]
        ]
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError):
        raise UserError(f"{path} is no capture of the profiler: record one, or name another file") from None


_profiler: Profiler = NullProfiler()


def use(profiler: Profiler) -> Profiler:
    """Send blocks to `profiler` from now on, and return the one before."""
    global _profiler
    before, _profiler = _profiler, profiler
    return before


def push(name: str) -> None:
    """Begin a block."""
    _profiler.push(name)


def pop() -> None:
    """End the innermost open block of this thread."""
    _profiler.pop()


def block(name: str) -> AbstractContextManager[None]:
    """Return a context that is a block."""
    return _profiler.block(name)


class FpsCounter:
    """Frames per second over windows of time; frames that were not drawn take time but do not count."""

    def __init__(self, window: float = 0.5) -> None:
        """`window` is in seconds; raises ValueError where it is not above 0."""
        if not window > 0.0:
            raise ValueError(f"a window of {window} s: it must be above 0")
        self._window = window
        self._elapsed = 0.0
        self._frames = 0
        self.fps = 0.0
        """The rate in the last full window, 0 before the first."""

    def tick(self, delta: float, rendered: bool = True) -> bool:
        """Count a frame of `delta` seconds; True when a window is full and `fps` is new."""
        self._elapsed += delta
        self._frames += rendered
        # A sum of ticks may end a rounding error below the window that they fill.
        if self._elapsed < self._window * (1 - 1e-9):
            return False
        self.fps = self._frames / self._elapsed
        self._elapsed, self._frames = 0.0, 0
        return True
