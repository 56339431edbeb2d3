"""A part of a reference, a few blocks of paths of one tile, traced in whatever process it comes to.

A process opens its device once and keeps a few renderers: knobs of paths, exposure and camera change from part to part
without a new one. All of it happens in one thread, since contexts of OpenGL belong to the thread that made them.
"""

from __future__ import annotations

import math
import signal
import time as clock
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chapters import scenes
from common.errors import DeviceError, UserError
from common.scene import Scene
from common.settings import flat, set_live
from tools.reference import contents
from tools.reference.command import Request
from tools.reference.settings import chapter_settings, tracer_settings
from tools.reference.sums import MOST_OF_BLOCK, block_after
from tools.reference.tiles import Tile, tiles_of
from tools.reference.tracing import Task, blocks_of, device_name, opened, task_of
from tools.run.run import open_device

Float32 = NDArray[np.float32]

MOST_BLOCKS = 16
MOST_BYTES = 64 << 20
"""A part has no more blocks and bytes of results, unless it is one block, and no more paths than one block may have."""

MOST_WAITING = 256 << 20
"""Bytes of results that may wait for earlier ones in the process that merges.

So many the parts of all tiles with the same paths have at most, unless each is one block. Where more wait, no part is
handed out but of the paths that are merged next.
"""

BYTES_OF_PIXEL = 24
RENDERERS, SCENES = 4, 2
"""How many of each stay open in a process."""


Key = tuple[int, int, int]
"""Tells parts of a sweep apart."""


@dataclass(frozen=True)
class Part:
    """Blocks of paths of one tile of a reference: the first begins behind `first` paths of each pixel.

    `facts` are what the sums of the reference depend on, as the process has them that merges.
    """

    request: Request
    facts: tuple[tuple[str, str], ...]
    reference: int
    first: int
    counts: tuple[int, ...]
    tile: Tile

    @property
    def key(self) -> Key:
        """The numbers of the reference, of the first path and of the tile: no other part of a sweep has all of them."""
        return self.reference, self.first, self.tile.number

    @property
    def end(self) -> int:
        """The number of paths behind its last block."""
        return self.first + sum(self.counts)


@dataclass(frozen=True, eq=False)
class Blocks:
    """What was traced of a part: for each block sums of light (h, w, 4) and of squares (h, w, 2), both float32."""

    sums: tuple[tuple[Float32, Float32], ...]
    device: str
    seconds: float


def counts_of(first: int, size: tuple[int, int], most: int) -> tuple[int, ...]:
    """Return the blocks of the parts of a picture that begin after `first` paths; none goes beyond `most` paths."""
    tiles, counts = tiles_of(size), list[int]()
    pixels, of_tile = math.prod(size), math.prod(tiles[0].size)
    paths = first
    while paths + (count := block_after(paths, pixels)) <= most:
        total, bytes_after = paths + count - first, (len(counts) + 1) * BYTES_OF_PIXEL * of_tile
        if counts and (
            len(counts) == MOST_BLOCKS
            or bytes_after > MOST_BYTES
            or bytes_after * len(tiles) > MOST_WAITING
            or total * of_tile > MOST_OF_BLOCK
        ):
            break
        counts.append(count)
        paths += count
    return tuple(counts)


class Loaded:
    """Scenes with their hashes, the last few ones."""

    def __init__(self) -> None:
        self._scenes: OrderedDict[tuple[str, str], tuple[Scene, str]] = OrderedDict()

    def get(self, request: Request) -> tuple[Scene, str]:
        """Return the scene of a request with the exposure asked for, and its hash. Raises UserError."""
        key = request.scene, request.environment
        if key not in self._scenes:
            scene = scenes.load(request.scene, None, request.environment)
            self._scenes[key] = scene, contents.scene_hash(scene)
        self._scenes.move_to_end(key)
        while len(self._scenes) > SCENES:
            self._scenes.popitem(last=False)
        scene, hashed = self._scenes[key]
        scene.ev100 = request.ev100
        return scene, hashed


def task_for(request: Request, scene: Scene) -> Task:
    """Return what a request has traced. Raises UserError."""
    own, of_paths = chapter_settings(request.chapter, request.overrides)
    settings = tracer_settings(own, request.filter, request.seed, of_paths)
    return task_of(settings, scene, request.camera, request.size, request.time, request.backend)


class Tracer:
    """The device and the renderers of a process."""

    def __init__(self) -> None:
        self._loaded = Loaded()
        self._tasks: OrderedDict[Request, tuple[Task, dict[str, str]]] = OrderedDict()
        self._renderers: list[tuple[tuple[Any, ...], Any]] = []
        self._devices: dict[str, Any] = {}
        self._stack = ExitStack()

    def trace(self, part: Part) -> Blocks:
        """Trace a part. Raises UserError where the process has another scene or another version than asked for."""
        task = self._task(part)
        try:
            return self._traced(part, task)
        except DeviceError:
            # A device that is full may have kept objects, and one that is lost stays so: the next part opens another.
            self.close()
            raise

    def _traced(self, part: Part, task: Task) -> Blocks:
        renderer = self._renderer(part.tile.size, task)
        firsts = accumulate(part.counts[:-1], initial=part.first)
        jobs = ((part.tile, first, count) for first, count in zip(firsts, part.counts, strict=True))
        began = clock.perf_counter()
        sums = [(np.array(light), np.array(squares)) for light, squares in blocks_of(renderer, task, jobs)]
        seconds = clock.perf_counter() - began
        return Blocks(tuple(sums), device_name(renderer.capabilities), seconds)

    def close(self) -> None:
        """Close renderers and device."""
        while self._renderers:
            self._renderers.pop()[1].close()
        self._stack.close()
        self._devices.clear()

    def _task(self, part: Part) -> Task:
        request = part.request
        if request not in self._tasks:
            scene, hashed = self._loaded.get(request)
            task = task_for(request, scene)
            self._tasks[request] = task, task.facts(hashed)
            while len(self._tasks) > RENDERERS:
                self._tasks.popitem(last=False)
        task, facts = self._tasks[request]
        other = [name for name, value in part.facts if facts.get(name) != value]
        if other:
            raise UserError(
                f"it would trace another picture (of another {' and another '.join(other)}): all workers need the same "
                "version of Strata and the same files of scenes."
            )
        return task

    def _renderer(self, size: tuple[int, int], task: Task) -> Any:
        """Return a renderer for tiles of a task: one that is open, if knobs alone differ that can be set in it."""
        key = size, task.backend, task.time
        for number, (found, renderer) in enumerate(self._renderers):
            if found == key and renderer.scene is task.scene and _takes(renderer.settings, task.settings):
                self._renderers.append(self._renderers.pop(number))
                return renderer
        while len(self._renderers) >= RENDERERS:
            self._renderers.pop(0)[1].close()
        if task.backend not in self._devices:
            self._devices[task.backend] = open_device(self._stack, task.backend)
        renderer = opened(task, size, self._devices[task.backend])
        self._renderers.append((key, renderer))
        return renderer


def _takes(settings: Any, wanted: Any) -> bool:
    """Whether an open renderer's settings have the wanted values, or take them over."""
    now = flat(settings)
    return all(value == now[name] for name, value in flat(wanted).items()) or set_live(settings, wanted)


# --- in a process of its own ---


@cache
def _thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "strata-sweep")


@cache
def _tracer() -> Tracer:
    return Tracer()


def trace_part(part: Part) -> Blocks:
    """Trace a part with what the process has open, in its one thread for that."""
    return _thread().submit(lambda: _tracer().trace(part)).result()


def dask_setup(worker: Any) -> None:
    """Leave Ctrl-C to the process that merges: a terminal sends it to all. Dask calls this in a new worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def dask_teardown(worker: Any) -> None:
    """Close what is open. Dask calls this where a worker ends in good order."""
    _thread().submit(_tracer().close).result()
