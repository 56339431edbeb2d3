"""Where parts of references are traced: in this process, or by workers of Dask, here or on other machines."""

from __future__ import annotations

import asyncio
import logging
import os
import queue
import re
import signal
import sys
import threading
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import Any, Protocol

from common import packages
from common.errors import StrataError, UserError
from tools.reference import contents
from tools.reference.sweep.work import Blocks, Key, Part, Tracer, trace_part

Outcome = tuple[Part, Blocks | Exception]

ANSWER_S = 10.0
"""How long a scheduler may take to answer, and to have a worker."""

DEATHS = 3
"""A part that was with so many workers when they ended is traced alone. On a cluster its own setting holds."""

WAIT_S = 0.25
"""How long `outcomes` waits: so often progress is shown, too."""

SILENT = logging.CRITICAL + 1
MOST_WORKERS = 256
ADDRESS = re.compile(r"(tcp|tls|ws|wss)://(\[[0-9a-fA-F:.]+\]|[^:/\s\[\]]+):(\d{1,5})")
VERSIONS = ("python", "distributed", "msgpack", "cloudpickle", "numpy")
"""What must be the same at both ends: the first for what is sent, numpy for the tables by which light is sampled."""


class Pool(Protocol):
    """Traces parts, several at a time."""

    where: str
    """Ends the sentence "24 references, ..."."""

    @property
    def workers(self) -> int:
        """How many parts are traced at once."""

    def submit(self, part: Part) -> None:
        """Have a part traced."""

    def outcomes(self) -> list[Outcome]:
        """Wait a while for parts that are done, or that failed."""

    def drop(self, keys: Collection[Key]) -> None:
        """Forget parts."""


class Here:
    """Traces one part after the other in this process, and needs no Dask."""

    where = "traced in this process"
    workers = 1

    def __init__(self) -> None:
        self._tracer = Tracer()
        self._parts: deque[Part] = deque()

    def start(self) -> None:
        """Do nothing: a device is opened for the first part."""

    def __enter__(self) -> Here:
        return self

    def __exit__(self, *error: object) -> None:
        self._tracer.close()

    def submit(self, part: Part) -> None:
        """Have a part traced."""
        self._parts.append(part)

    def outcomes(self) -> list[Outcome]:
        """Trace the next part."""
        part = self._parts.popleft()
        try:
            return [(part, self._tracer.trace(part))]
        except StrataError as error:
            return [(part, error)]

    def drop(self, keys: Collection[Key]) -> None:
        """Forget parts."""
        self._parts = deque(part for part in self._parts if part.key not in keys)


class Workers:
    """Workers of Dask: `count` processes of this machine, or those of the scheduler at an address.

    A part whose worker ends is traced by another one. Dask blames the end of a worker on all parts that are at it, and
    one of these may only have waited there: parts with `DEATHS` such ends are traced again, each of them alone, and a
    part is given up where its workers end then, too. `run` is what a worker does with a part.
    """

    def __init__(
        self, count: int, address: str | None = None, run: Callable[[Part], Blocks] = trace_part
    ) -> None:
        self._count, self._address, self._run = count, address, run
        self._futures: dict[Key, Any] = {}
        self._suspects: deque[Part] = deque()
        """Parts that are to be traced alone."""
        self._alone: Key | None = None
        """The part that is traced alone."""
        self._held: deque[Part] = deque()
        """Parts that wait until no part is to be traced alone."""
        self._done: queue.SimpleQueue[tuple[Part, Any]] = queue.SimpleQueue()
        self._stack = ExitStack()
        self.cluster: Any = None
        """Dask's cluster of this machine, or None."""
        self.where = ""

    def start(self) -> None:
        """Start workers, or connect to them. Raises UserError. To be followed by `with`, which closes them."""
        option = f"--workers {self._count}" if self._address is None else f"--cluster {self._address}"
        try:
            self._dask: Any = packages.load("distributed")
        except ImportError as error:
            raise UserError(
                f"{option} needs the package distributed, which {error}: ./strata --extras installs it with all extras "
                "(its own is `cluster`); --workers 0 traces in this process."
            ) from None
        try:
            self._stack.enter_context(_silent())
            if self._address is None:
                with _uninterrupted():
                    self._client = self._started(self._count)
            else:
                self._client = self._connected(self._address)
        except BaseException:
            self._stack.close()
            raise
        count = self.workers
        of = "" if self._address is None else f" of {self._address}"
        self.where = f"traced by {count} worker{'s' * (count > 1)}{of}"

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *error: object) -> None:
        self._futures.clear()
        self._stack.close()

    def _started(self, count: int) -> Any:
        """Return a client of new workers on this machine."""
        config = packages.load("dask").config
        self._stack.enter_context(config.set({"distributed.scheduler.allowed-failures": DEATHS - 1}))
        self.cluster = self._stack.enter_context(
            self._dask.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                dashboard_address=None,
                memory_limit=None,  # else Dask ends workers that it thinks too large
                silence_logs=SILENT,
                preload="tools.reference.sweep.work",
                env=_own_threads(count),
            )
        )
        return self._stack.enter_context(self._dask.Client(self.cluster, set_as_default=False))

    def _connected(self, address: str) -> Any:
        """Return a client of the scheduler at an address. Raises UserError where it cannot be used."""
        try:
            asyncio.run(asyncio.wait_for(self._answer(address), ANSWER_S))
            client = self._dask.Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, TimeoutError):
            raise UserError(
                f"--cluster {address} does not answer within {ANSWER_S:g} s: start `python -m dask scheduler` in the "
                "folder of Strata there."
            ) from None
        self._stack.enter_context(client)
        try:
            client.wait_for_workers(1, timeout=ANSWER_S)
        except TimeoutError:
            raise UserError(
                f"--cluster {address} has no workers: start `python -m dask worker {address} --nthreads 1` in the "
                "folder of Strata on each machine."
            ) from None
        check_versions(address, client.get_versions(packages=["numpy"]))
        try:
            found = {"the scheduler": client.run_on_scheduler(version), **client.run(version)}
        except Exception as error:  # whatever a process without our modules makes of them
            raise UserError(
                f"--cluster {address} cannot import Strata ({error}): start scheduler and workers by `python -m dask` "
                "in its folder."
            ) from None
        other = sorted(name for name, text in found.items() if text != version())
        if other:
            raise UserError(f"--cluster {address}: {', '.join(other)} has another version of Strata.")
        return client

    async def _answer(self, address: str) -> None:
        """Ask a scheduler for its name: Dask's client waits for ever where something listens and says nothing."""
        core = self._dask.core
        security = self._dask.Security().get_connection_args("client")
        comm = await core.connect(address, timeout=ANSWER_S, **security)
        try:
            await core.send_recv(comm, op="identity", reply=True)
        finally:
            comm.abort()

    @property
    def workers(self) -> int:
        """How many parts are traced at once: workers of a cluster come and go."""
        return self._count if self._address is None else max(len(self._client.nthreads()), 1)

    def submit(self, part: Part) -> None:
        """Have a part traced."""
        if self._suspects or self._alone is not None:
            self._held.append(part)
        else:
            self._send(part)

    def _send(self, part: Part) -> None:
        name = f"part-{'-'.join(map(str, part.key))}-{uuid.uuid4().hex}"
        future = self._client.submit(self._run, part, key=name, pure=False, priority=-part.reference)
        self._futures[part.key] = future
        future.add_done_callback(lambda done: self._done.put((part, done)))

    def outcomes(self) -> list[Outcome]:
        """Wait a while for parts that are done, or that failed. Raises UserError where the cluster is gone."""
        try:
            part, done = self._done.get(timeout=WAIT_S)
        except queue.Empty:
            if self._client.status == "closed":
                raise UserError(self._gone()) from None
            return []
        if self._futures.get(part.key) is not done:  # it was dropped
            return []
        future = self._futures.pop(part.key)
        try:
            return [(part, future.result())]
        except self._dask.KilledWorker as killed:
            if part.key != self._alone:
                self._suspects.append(part)
                return []
            deaths = killed.allowed_failures + 1
            return [(part, UserError(f"{_spoken(part)} ended {deaths} workers, one after the other"))]
        except StrataError as error:
            return [(part, error)]
        except (CancelledError, asyncio.CancelledError):
            raise UserError(self._gone()) from None
        finally:
            self._go_on()

    def drop(self, keys: Collection[Key]) -> None:
        """Forget parts; those that are being traced end by themselves."""
        futures = [self._futures.pop(key) for key in keys if key in self._futures]
        if futures:
            self._client.cancel(futures)
        self._suspects, self._held = (
            deque(part for part in parts if part.key not in keys) for parts in (self._suspects, self._held)
        )
        self._go_on()

    def _go_on(self) -> None:
        """Once no part is traced, have the next one traced alone; where there is none, all that were held back."""
        if self._futures:
            return
        self._alone = None
        if self._suspects:
            part = self._suspects.popleft()
            self._alone = part.key
            self._send(part)
        while self._held and self._alone is None:
            self._send(self._held.popleft())

    def _gone(self) -> str:
        return f"--cluster {self._address} went away." if self._address else "The workers went away."


def _own_threads(workers: int) -> dict[str, str]:
    """Return variables by which Mesa's software drivers share the processor; other drivers do not know them."""
    if "LP_NUM_THREADS" in os.environ:
        return {}
    return {"LP_NUM_THREADS": str(max((os.cpu_count() or 1) // workers, 1))}


def version() -> str:
    """Return a hash of the path tracer's texts where this is called."""
    return contents.tracer_hash()


def check_address(address: str) -> None:
    """Raise UserError for what is no address of a scheduler."""
    match = ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match[3]) < 65536:
        raise UserError(f"--cluster {address!r} is no address: write one such as tcp://10.0.0.1:8786.")


def check_versions(address: str, found: dict[str, Any]) -> None:
    """Raise UserError where packages differ between this process, the scheduler and the workers."""
    own = _versions(found["client"])
    for name, told in {"the scheduler": found["scheduler"], **found["workers"]}.items():
        for package, wanted in own.items():
            if (version_there := _versions(told).get(package)) != wanted:
                raise UserError(
                    f"--cluster {address}: {name} has {package} {version_there}, and here is {wanted}: install "
                    "the same versions on all machines."
                )


def _versions(told: dict[str, Any]) -> dict[str, str]:
    texts = {**told.get("host", {}), **told.get("packages", {})}
    found = {name: str(texts.get(name)) for name in VERSIONS}
    found["python"] = ".".join(found["python"].split(".")[:2])
    return found


def _spoken(part: Part) -> str:
    (x, y), (width, height) = part.tile.first, part.tile.size
    whole = part.tile.size == part.request.size
    where = "" if whole else f" in the tile of {width}x{height} pixels at {x},{y}"
    return f"the part with its paths {part.first} to {part.end - 1}{where}"


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Have Ctrl-C wait until workers are started, and not reach these, nor those that take their places.

    A terminal sends it to all processes. Threads and processes that are started here inherit what is blocked.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _start_tracker()
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    mask = getattr(signal, "pthread_sigmask", None)  # Windows has none
    blocked = mask(signal.SIG_BLOCK, {signal.SIGINT}) if mask else None
    try:
        yield
    finally:
        if mask:
            mask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


def _start_tracker() -> None:
    """Start the process that removes what others leave behind, without its warning: `prompt_stop` leaves semaphores."""
    variable = "PYTHONWARNINGS"
    before = os.environ.get(variable)
    os.environ[variable] = "ignore::UserWarning"
    try:
        if sys.platform != "win32":
            resource_tracker.ensure_running()
    finally:
        del os.environ[variable]
        if before is not None:
            os.environ[variable] = before


@contextmanager
def _silent() -> Iterator[None]:
    """Have Dask print nothing of its own: what matters is said in sentences of ours."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    before = {name: logging.getLogger(name).level for name in {"distributed", *names}}
    for name in before:  # Dask's configuration gives some a level of their own
        logging.getLogger(name).setLevel(SILENT)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"(dask|distributed|tornado)\b")
        try:
            yield
        finally:
            for name, level in before.items():
                logging.getLogger(name).setLevel(level)
