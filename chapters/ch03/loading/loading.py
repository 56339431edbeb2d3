"""Textures on their way from a file to the GPU: who waits, what is decoded on which thread, what is handed over.

A request begins by waiting. Tasks decode the most important ones on the scheduler's threads and put what they made on
one list, behind a lock. The renderer's thread takes each of them from there exactly once and copies it to the GPU:

    waiting -> decoding -> decoded -> uploading -> resident
                  |           |           |
                  +-> failed  +-----------+-> cancelled, when no material reads it any more

What is decoded and not yet copied is bounded: with a slow copy and fast threads, memory would otherwise hold all.
Everything here is the same on either backend.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any

import numpy as np

from common.errors import SceneError, StrataError
from common.scene import Scene

from ..settings import Settings
from ..tasks.errors import TaskCancelledError
from ..tasks.state import Task
from ..tasks.switching import QuickTurns
from ..tasks.workers import Workers
from .uploads import Upload

AHEAD = 4 << 20
"""Bytes that each thread may decode before somebody copies them; one image may be larger."""

MOST_AHEAD = 256 << 20
"""Bytes that all threads together may decode ahead; two images may be larger, one decoded while the other is copied."""

MOST_BESIDE = 12 << 20
"""Bytes that are decoded beside the reading of geometry, before anybody asks: that needs as much memory itself."""


def threads_at_most() -> int:
    """Return how many threads decode where a scene is opened and nothing else is done."""
    return min(8, os.cpu_count() or 1)


def beside_geometry() -> int:
    """Return how many bytes of pictures are decoded while a scene's geometry is read."""
    return min(AHEAD * threads_at_most(), MOST_BESIDE)


class State(Enum):
    """How far a request is."""

    WAITING = "waits for a thread"
    DECODING = "is decoded"
    DECODED = "waits to be copied"
    UPLOADING = "is copied"
    RESIDENT = "can be sampled"
    FAILED = "could not be decoded"
    CANCELLED = "is not wanted any more"


@dataclass(frozen=True)
class Wanted:
    """What is asked for: `make` decodes it on any thread, into about `nbytes` bytes; `materials` read it."""

    name: str
    nbytes: int
    make: Callable[[], Upload]
    materials: Sequence[int] = ()


@dataclass(eq=False)
class Request:
    """One image on its way. `place` is its place among all that are wanted."""

    key: Hashable
    wanted: Wanted
    place: int
    state: State = State.WAITING
    upload: Upload | None = None
    """The pixels, from `DECODED` until they are copied."""
    held_bytes: int = 0
    """What it counts for among the bytes that are decoded ahead."""
    error: BaseException | None = None


class Loading:
    """All requests of a renderer. Its methods are for the renderer's thread; decoding runs on `threads` others.

    The order in which requests are decoded is that of `prioritise`, and the scene's where that says nothing. It decides
    about when a texture arrives, never about what it holds.
    """

    def __init__(
        self, threads: int, streams: bool = False, budget: int = AHEAD, ahead: int | None = None
    ) -> None:
        """`streams`: frames are drawn meanwhile, each of which copies `budget` bytes; else all is there before.

        `ahead` are the bytes that may be decoded and not yet copied. By default each thread has an image, however large
        they are, and the next one to copy waits.
        """
        self._workers, self._given, self._ahead = Workers(threads), ahead, ahead or 0
        self.streams, self.budget = streams, budget
        self._working = False  # whether there are threads
        self._turns = QuickTurns()
        self._lock = threading.Lock()
        self._news = threading.Condition(self._lock)
        self._ended = self._seen = 0  # tasks that have ended, in all and when somebody last looked
        # Behind the lock: what tasks change, too.
        self._waiting: list[Request] = []  # the most important last
        self._running: dict[Request, Task[None]] = {}
        self._decoded: deque[Request] = deque()
        self._failed: list[Request] = []
        self._held_bytes = self._lost = 0
        # The renderer's alone.
        self._resident = 0
        self.requests: dict[Hashable, Request] = {}
        self._reads = np.zeros((2, 0), np.int64)

    @classmethod
    def of(cls, settings: Settings, presents: bool) -> Loading:
        """Return what the settings ask for; `presents`: whether there is a window, in which one can watch."""
        streams = settings.loading == "stream" or (settings.loading == "auto" and presents)
        threads = settings.decoding_threads or min(8, max(1, (os.cpu_count() or 2) - 1))
        return cls(threads, streams, max(1, int(settings.upload_budget * 2**20)))

    # --- what is wanted -----------------------------------------------------------------------------------------------

    def want(self, wanted: Mapping[Hashable, Wanted]) -> list[Request]:
        """Ask for all of `wanted`, and for nothing else; return the requests that this cancelled.

        What was asked for before goes on, or is there; what failed is tried once more. A texture that nobody reads is
        not decoded any more, and what was decoded of it is dropped.
        """
        with self._lock:
            failed = State.FAILED
            gone = [one for key, one in self.requests.items() if key not in wanted or one.state is failed]
            before = [request.state for request in gone]
            for request in gone:
                del self.requests[request.key]
                if request.state is State.DECODED:
                    self._decoded.remove(request)
                if request.state is not State.DECODING:  # else its task still counts, until it ends
                    self._release(request)
                request.state = State.CANCELLED
            self._waiting = [request for request in self._waiting if request.state is State.WAITING]
            for place, (key, one) in enumerate(wanted.items()):
                if key in self.requests:
                    self.requests[key].place = place
                else:
                    self.requests[key] = Request(key, one, place)
                    self._waiting.append(self.requests[key])
            self._waiting.sort(key=lambda request: -request.place)
            if self._given is None:
                largest = max((request.wanted.nbytes for request in self._waiting), default=0)
                ahead = (self._workers.count + 1) * max(AHEAD, largest)
                self._ahead = min(ahead, max(MOST_AHEAD, 2 * largest))
            states = [request.state for request in self.requests.values()]
            self._resident, self._lost = states.count(State.RESIDENT), states.count(State.FAILED)
        counts = [len(one.materials) for one in wanted.values()]
        materials = [material for one in wanted.values() for material in one.materials]
        self._reads = np.stack([np.repeat(np.arange(len(wanted)), counts), np.array(materials, np.int64)])
        return [
            request
            for request, state in zip(gone, before, strict=True)
            if state in (State.UPLOADING, State.RESIDENT)
        ]

    def prioritise(self, sizes: np.ndarray) -> None:
        """Order what waits by `sizes` (M,), how large each material is on the screen; equal ones as in the scene."""
        places, materials = self._reads
        largest = np.zeros(len(self.requests))
        np.maximum.at(largest, places, sizes[materials])
        with self._lock:
            waiting = np.array([request.place for request in self._waiting], np.int64)
            order = np.lexsort((-waiting, largest[waiting])) if len(waiting) else ()
            self._waiting = [self._waiting[number] for number in order]

    # --- decoding -----------------------------------------------------------------------------------------------------

    def feed(self) -> None:
        """Begin to decode as many requests as there are threads, while little enough is decoded ahead."""
        with self._lock:
            if self._waiting:
                self._working = True
                if self.streams:
                    self._turns.begin()
                self._feed(self._workers.tasks.spawn)

    def _feed(self, spawn: Callable[..., Task[None]]) -> None:
        while self._waiting and len(self._running) < self._workers.count:
            request = self._waiting[-1]
            if self._held_bytes and self._held_bytes + request.wanted.nbytes > self._ahead:
                return
            self._waiting.pop()
            request.state = State.DECODING
            self._hold(request, request.wanted.nbytes)
            try:
                self._running[request] = spawn(
                    f"decode {request.wanted.name}", partial(self._decode, request, spawn)
                )
            except TaskCancelledError:  # the renderer is being closed, and nobody waits for it
                request.state = State.CANCELLED
                self._release(request)
                return

    def _decode(self, request: Request, spawn: Callable[..., Task[None]]) -> None:
        """Be the task that decodes a request, and begin another one at its end."""
        upload: Upload | None = None
        error: BaseException | None = None
        try:
            if request.state is State.DECODING:  # else it was cancelled before it began
                upload = request.wanted.make()
        except BaseException as raised:  # who waits is told of it, whatever it is
            error = raised
        with self._lock:
            del self._running[request]
            self._release(request)
            if request.state is State.CANCELLED:
                pass
            elif upload is None:
                request.state, request.error = State.FAILED, error
                self._failed.append(request)
                self._lost += 1
            else:
                request.state, request.upload = State.DECODED, upload
                self._hold(request, upload.nbytes)
                self._decoded.append(request)
            self._ended += 1
            self._feed(spawn)
            self._news.notify_all()

    def _hold(self, request: Request, nbytes: int) -> None:
        request.held_bytes = nbytes
        self._held_bytes += nbytes

    def _release(self, request: Request) -> None:
        self._held_bytes -= request.held_bytes
        request.held_bytes, request.upload = 0, None

    # --- handing over -------------------------------------------------------------------------------------------------

    def take(self) -> Request | None:
        """Return a decoded request, which is being uploaded from now on, or None. Each is returned once."""
        with self._lock:
            if not self._decoded:
                self._seen = self._ended
                return None
            request = self._decoded.popleft()
            request.state = State.UPLOADING
            return request

    def copied(self, request: Request) -> None:
        """Free the pixels of a request, all of which have been copied."""
        with self._lock:
            self._release(request)

    def arrived(self, request: Request) -> None:
        """Note that a texture can be sampled."""
        request.state = State.RESIDENT
        self._resident += 1

    def failures(self) -> list[Request]:
        """Return the requests that have failed since the last call."""
        with self._lock:
            failed, self._failed = self._failed, []
            return failed

    def refuse_failed(self) -> None:
        """Raise SceneError where something could not be decoded, unless frames are drawn without it."""
        failed = [] if self.streams else self.failures()
        if failed:
            raise refusal(min(failed, key=lambda request: request.place))

    def resident(self, key: Hashable) -> bool:
        """Whether what was asked for as `key` can be sampled."""
        request = self.requests.get(key)
        return request is not None and request.state is State.RESIDENT

    @property
    def decoding(self) -> bool:
        """Whether anything waits for a thread, or has one."""
        with self._lock:
            return bool(self._waiting or self._running)

    @property
    def decoded(self) -> bool:
        """Whether there is something to take."""
        return bool(self._decoded)

    @property
    def busy(self) -> bool:
        """Whether anything that is wanted has neither arrived nor failed."""
        return self._resident + self._lost < len(self.requests)

    @property
    def wanted_bytes(self) -> int:
        """About how many bytes are still to be copied of all that is wanted."""
        left = (State.WAITING, State.DECODING, State.DECODED, State.UPLOADING)
        return sum(one.wanted.nbytes for one in self.requests.values() if one.state in left)

    @property
    def held_bytes(self) -> int:
        """Bytes that are decoded, or being decoded, and not yet copied."""
        return self._held_bytes

    def counts(self, textures: int, copied: int) -> dict[str, int]:
        """Return the counters of `Frame.work`: `textures` on the GPU, those on their way or lost, bytes just copied."""
        return {
            "textures": textures,
            "textures_resident": self._resident,
            "textures_waiting": len(self.requests) - self._resident - self._lost,
            "textures_failed": self._lost,
            "bytes_uploaded": copied,
        }

    def wait(self) -> None:
        """Wait until one more of the requests is decoded, or cannot be; return at once if none is on its way.

        Whichever is the first: to wait for a certain one, that takes long, would stop the others at what may be ahead.
        """
        self.feed()
        with self._lock:
            while self._running and self._ended == self._seen:
                self._news.wait()
            self._seen = self._ended

    def rest(self) -> None:
        """Join the threads, if they have nothing left to do; the next request has others."""
        if self._working and not self.decoding:
            self._join()

    def stop(self) -> list[Request]:
        """Cancel what has not arrived and join the threads; return what was being copied."""
        left = {key: one.wanted for key, one in self.requests.items() if one.state is State.RESIDENT}
        stopped = self.want(left)
        self._join()
        return stopped

    def _join(self) -> None:
        try:
            self._workers.close()
        finally:
            self._turns.end()
        self._workers, self._working = Workers(self._workers.count), False
        for request in self._running:  # tasks that never began
            self._release(request)
        self._running.clear()

    def close(self) -> None:
        """Do as `stop`."""
        self.stop()


def report_failures(loading: Loading, scene: Scene) -> None:
    """Add a sentence to the scene's warnings for each texture that has failed since the last time."""
    for request in loading.failures():
        scene.warnings.append(sentence(request, "it is drawn without its texture"))


def sentence(request: Request, then: str) -> str:
    """Return what is said of a request that failed; `then` is what comes of it."""
    error: Any = request.error
    said = str(error).rstrip(".") if str(error) else type(error).__name__
    if isinstance(error, StrataError):  # it names the place and what to do
        return f"{said}: {then}."
    return f"{request.wanted.name} cannot be decoded ({said}): {then}."


def refusal(request: Request) -> SceneError:
    """Return the error that a request failed with, for a renderer that does not draw without it."""
    if isinstance(request.error, SceneError):
        return request.error
    return SceneError(sentence(request, "save the image again"))
