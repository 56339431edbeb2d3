"""Requests for textures: waiting, decoded on threads, and handed over to the renderer's thread.

Tasks on the scheduler's threads decode the most important requests, and append the results to a list that has a lock.
The renderer's thread takes each result from there once and copies it to the GPU:

    waiting -> decoding -> decoded -> uploading -> resident
                  |           |           |
                  +-> failed  +-----------+-> cancelled, when no material reads it any more

The number of decoded bytes that wait for their copy is limited; otherwise slow copies and fast threads would fill the
memory with all textures. This code is the same on both backends.
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

from ..tasks.errors import TaskCancelledError
from ..tasks.state import Task
from ..tasks.switching import QuickTurns
from ..tasks.workers import Workers
from .settings import LoadingSettings
from .uploads import Upload

AHEAD = 4 << 20
"""Bytes that each thread may decode before they are copied; one image may be larger."""

MOST_AHEAD = 256 << 20
"""Bytes that all threads may decode ahead; two images may be larger: one is decoded while the other is copied."""

MOST_BESIDE = 12 << 20
"""Bytes that are decoded while geometry is read; reading geometry needs as much memory itself."""


def threads_at_most() -> int:
    """Return the number of decoding threads while a scene is opened."""
    return min(8, os.cpu_count() or 1)


def beside_geometry() -> int:
    """Return the bytes of pictures to decode while the geometry of a scene is read."""
    return min(AHEAD * threads_at_most(), MOST_BESIDE)


class State(Enum):
    """The state of a request."""

    WAITING = "waits for a thread"
    DECODING = "is decoded"
    DECODED = "waits to be copied"
    UPLOADING = "is copied"
    RESIDENT = "can be sampled"
    FAILED = "could not be decoded"
    CANCELLED = "is not wanted any more"


@dataclass(frozen=True)
class Wanted:
    """A wanted texture: `make` decodes it on any thread, into about `nbytes` bytes; `materials` read it."""

    name: str
    nbytes: int
    make: Callable[[], Upload]
    materials: Sequence[int] = ()


@dataclass(eq=False)
class Request:
    """The request for one image. `place` is its number among all wanted images."""

    key: Hashable
    wanted: Wanted
    place: int
    state: State = State.WAITING
    upload: Upload | None = None
    """The pixels, from `DECODED` until they are copied."""
    held_bytes: int = 0
    """Its share of the bytes that are decoded ahead."""
    error: BaseException | None = None


class Loading:
    """All requests of a renderer. Its methods are for the renderer's thread; decoding runs on `threads` others.

    Requests are decoded in the order of `prioritise`, and equal ones in the order of the scene. The order decides when
    a texture arrives, never its contents.
    """

    def __init__(
        self, threads: int, streams: bool = False, budget: int = AHEAD, ahead: int | None = None
    ) -> None:
        """With `streams`, frames are drawn meanwhile and copy `budget` bytes each; else loading ends before the first
        frame.

        `ahead` is the number of bytes that may be decoded before they are copied. By default each thread may hold one
        image of any size, and one more waits for its copy.
        """
        self._workers, self._given, self._ahead = Workers(threads), ahead, ahead or 0
        self.streams, self.budget = streams, budget
        self._working = False  # whether there are threads
        self._turns = QuickTurns()
        self._lock = threading.Lock()
        self._news = threading.Condition(self._lock)
        self._ended = self._seen = 0  # tasks that have ended: in all, and at the last call of `wait`
        # Changed by tasks, too, and only with the lock.
        self._waiting: list[Request] = []  # the most important last
        self._running: dict[Request, Task[None]] = {}
        self._decoded: deque[Request] = deque()
        self._failed: list[Request] = []
        self._held_bytes = self._lost = 0
        # Of the renderer's thread only.
        self._resident = 0
        self.requests: dict[Hashable, Request] = {}
        self._reads = np.zeros((2, 0), np.int64)

    @classmethod
    def of(cls, settings: LoadingSettings, presents: bool) -> Loading:
        """Return the loading of these settings; with `presents` there is a window that shows its progress."""
        streams = settings.mode == "stream" or (settings.mode == "auto" and presents)
        threads = settings.decoding_threads or min(8, max(1, (os.cpu_count() or 2) - 1))
        return cls(threads, streams, max(1, int(settings.upload_budget * 2**20)))

    # --- wanted textures ----------------------------------------------------------------------------------------------

    def want(self, wanted: Mapping[Hashable, Wanted]) -> list[Request]:
        """Request all of `wanted` and nothing else; return the cancelled requests.

        Earlier requests go on or have arrived; failed ones are tried once more. Textures that no material reads are no
        longer decoded, and their decoded pixels are dropped.
        """
        with self._lock:
            failed = State.FAILED
            gone = [it for key, it in self.requests.items() if key not in wanted or it.state is failed]
            before = [request.state for request in gone]
            for request in gone:
                del self.requests[request.key]
                if request.state is State.DECODED:
                    self._decoded.remove(request)
                if request.state is not State.DECODING:  # else its task still counts, until it ends
                    self._release(request)
                request.state = State.CANCELLED
            self._waiting = [request for request in self._waiting if request.state is State.WAITING]
            for place, (key, texture) in enumerate(wanted.items()):
                if key in self.requests:
                    self.requests[key].place = place
                else:
                    self.requests[key] = Request(key, texture, place)
                    self._waiting.append(self.requests[key])
            self._waiting.sort(key=lambda request: -request.place)
            if self._given is None:
                largest = max((request.wanted.nbytes for request in self._waiting), default=0)
                ahead = (self._workers.count + 1) * max(AHEAD, largest)
                self._ahead = min(ahead, max(MOST_AHEAD, 2 * largest))
            states = [request.state for request in self.requests.values()]
            self._resident, self._lost = states.count(State.RESIDENT), states.count(State.FAILED)
        counts = [len(texture.materials) for texture in wanted.values()]
        materials = [material for texture in wanted.values() for material in texture.materials]
        self._reads = np.stack([np.repeat(np.arange(len(wanted)), counts), np.array(materials, np.int64)])
        return [
            request
            for request, state in zip(gone, before, strict=True)
            if state in (State.UPLOADING, State.RESIDENT)
        ]

    def prioritise(self, sizes: np.ndarray) -> None:
        """Order waiting requests by `sizes` (M,), the sizes of materials on the screen; equal ones as in the scene."""
        places, materials = self._reads
        largest = np.zeros(len(self.requests))
        np.maximum.at(largest, places, sizes[materials])
        with self._lock:
            waiting = np.array([request.place for request in self._waiting], np.int64)
            order = np.lexsort((-waiting, largest[waiting])) if len(waiting) else ()
            self._waiting = [self._waiting[number] for number in order]

    # --- decoding -----------------------------------------------------------------------------------------------------

    def feed(self) -> None:
        """Start decoding as many requests as there are threads, within the limit of decoded bytes."""
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
            except TaskCancelledError:  # the renderer is being closed
                request.state = State.CANCELLED
                self._release(request)
                return

    def _decode(self, request: Request, spawn: Callable[..., Task[None]]) -> None:
        """Run the task that decodes a request, and start another one at its end."""
        upload: Upload | None = None
        error: BaseException | None = None
        try:
            if request.state is State.DECODING:  # else it was cancelled before it began
                upload = request.wanted.make()
        except BaseException as raised:  # handed to the thread that waits
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

    # --- hand-over to the renderer ------------------------------------------------------------------------------------

    def take(self) -> Request | None:
        """Return a decoded request or None; each is returned once, and its state becomes `UPLOADING`."""
        with self._lock:
            if not self._decoded:
                self._seen = self._ended
                return None
            request = self._decoded.popleft()
            request.state = State.UPLOADING
            return request

    def copied(self, request: Request) -> None:
        """Free the pixels of a request after they were copied."""
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
        """Raise SceneError if a texture could not be decoded, unless frames stream textures."""
        failed = [] if self.streams else self.failures()
        if failed:
            raise refusal(min(failed, key=lambda request: request.place))

    def resident(self, key: Hashable) -> bool:
        """Whether the texture of `key` can be sampled."""
        request = self.requests.get(key)
        return request is not None and request.state is State.RESIDENT

    @property
    def decoding(self) -> bool:
        """Whether a request waits for a thread or is being decoded."""
        with self._lock:
            return bool(self._waiting or self._running)

    @property
    def decoded(self) -> bool:
        """Whether `take` would return a request."""
        return bool(self._decoded)

    @property
    def busy(self) -> bool:
        """Whether a wanted texture has neither arrived nor failed."""
        return self._resident + self._lost < len(self.requests)

    @property
    def wanted_bytes(self) -> int:
        """The approximate number of bytes still to be copied."""
        left = (State.WAITING, State.DECODING, State.DECODED, State.UPLOADING)
        return sum(it.wanted.nbytes for it in self.requests.values() if it.state in left)

    @property
    def held_bytes(self) -> int:
        """Bytes that are decoded or being decoded, and not copied yet."""
        return self._held_bytes

    def counts(self, textures: int, copied: int) -> dict[str, int]:
        """Return the counters of `Frame.work`: resident, loading and failed textures, and bytes just copied."""
        return {
            "textures": textures,
            "textures_resident": self._resident,
            "textures_waiting": len(self.requests) - self._resident - self._lost,
            "textures_failed": self._lost,
            "bytes_uploaded": copied,
        }

    def wait(self) -> None:
        """Wait until one more request is decoded or has failed; return at once if none is being decoded.

        It waits for any request: waiting for one slow request would stop the others at the limit of decoded bytes.
        """
        self.feed()
        with self._lock:
            while self._running and self._ended == self._seen:
                self._news.wait()
            self._seen = self._ended

    def rest(self) -> None:
        """Join the threads if they have no work; the next request starts new ones."""
        if self._working and not self.decoding:
            self._join()

    def stop(self) -> list[Request]:
        """Cancel requests that have not arrived and join the threads; return those that were being copied."""
        left = {key: it.wanted for key, it in self.requests.items() if it.state is State.RESIDENT}
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
        """Stop."""
        self.stop()


def report_failures(loading: Loading, scene: Scene) -> None:
    """Add a sentence to the scene's warnings for each texture that has failed since the last time."""
    for request in loading.failures():
        scene.warnings.append(sentence(request, "it is drawn without its texture"))


def sentence(request: Request, then: str) -> str:
    """Return the sentence about a failed request; `then` is its consequence."""
    error: Any = request.error
    said = str(error).rstrip(".") if str(error) else type(error).__name__
    if isinstance(error, StrataError):  # it already says where and what to do
        return f"{said}: {then}."
    return f"{request.wanted.name} cannot be decoded ({said}): {then}."


def refusal(request: Request) -> SceneError:
    """Return the error of a failed request, for a renderer that does not draw without its texture."""
    if isinstance(request.error, SceneError):
        return request.error
    return SceneError(sentence(request, "save the image again"))
