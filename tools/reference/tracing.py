"""Tracing of references: blocks of paths until the estimated error is small, and sums that outlive the process.

    picture, error = reference(1, scenes.load("cornell"), None, (320, 180), 0.01)

Sums are kept in the cache under what they depend on (`contents`). A second call with the same error traces nothing, and
one with a smaller error goes on with the next paths.
"""

from __future__ import annotations

import contextlib
import hashlib
import platform
import threading
import time as clock
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import chapters
from chapters.folders import Folder
from common.errors import UserError
from common.files import disk_cache
from common.machine import free_memory
from common.paths import cache_dir
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import replaced
from common.view.camera import View, exposure, view_of_scene
from tools.reference import contents
from tools.reference.settings import TRACER, chapter_settings, tracer_settings
from tools.reference.sums import CHANNELS, Sums, block_after, is_judged, read_sums, write_sums
from tools.reference.tiles import Tile, merged, tiles_of

Float32 = NDArray[np.float32]

FILTERS = ("box", "centre")
DEFAULT_PATHS = 1 << 16
MOST_PATHS = 1 << 30
MOST_SEED = 2**31
KEEP_EVERY_S = 30.0
"""Seconds between two times at which sums are written while paths are traced; ten times what that takes, if longer."""

BYTES_OF_PIXEL = (8 + 8 + 4) * sum(CHANNELS.values())
"""What a pixel takes of the machine's memory at least: its sums before and after a block, and those of the block."""

VECTORS = ("sse", "ssse", "avx", "fma", "f16c", "bmi", "asimd", "fp", "sve")
"""How the features of a processor begin on which a compiled shader's bits may depend."""

CACHE_BYTES = 4 << 30
"""The sums that were needed longest ago are removed from the cache where it is larger."""


@dataclass(frozen=True, eq=False)
class Task:
    """A picture to trace: scene, view, time, size in pixels, and the settings of the path tracer."""

    scene: Scene
    view: View
    time: float
    size: tuple[int, int]
    backend: str
    settings: Any

    def facts(self, hashed: str | None = None) -> dict[str, str]:
        """Return what its sums depend on; `hashed` is the scene's hash, where that is known already."""
        of_picture = self.scene, self.view, self.time, self.size, self.backend, self.settings
        return contents.facts_of(*of_picture, hashed)

    @property
    def exposure(self) -> float:
        """The factor from nits to the picture's values."""
        return exposure(self.view.ev100)


class Keeper:
    """The file with the sums of a task, or None: they are kept in memory alone. `named` says that the user named it.

    `sums` are the newest ones. Any thread may ask to keep them.
    """

    def __init__(
        self, path: Path | None, facts: dict[str, str], size: tuple[int, int], named: bool = False
    ) -> None:
        self.path, self.facts, self.size = path, facts, size
        self.sums = Sums.none_of(size)
        self.problem = ""
        """What the system said when the file could not be written, or ""."""
        self._named, self._kept = named, 0
        self._lock = threading.Lock()
        if path is None or not path.exists():
            return
        # What the cache holds can be made again, and so a damaged file of it counts for nothing.
        with contextlib.nullcontext() if named else contextlib.suppress(UserError):
            self.sums = read_sums(path, facts, size)
            self._kept = self.sums.paths
            disk_cache.mark_read(path)

    @property
    def is_kept(self) -> bool:
        """Whether the file has all paths."""
        return self._kept == self.sums.paths

    def keep(self) -> bool:
        """Write the newest sums, unless the file has them; return whether it has them now."""
        with self._lock:
            sums = self.sums
            if self.path is None or self._kept == sums.paths:
                return self.path is not None
            try:
                write_sums(self.path, sums, self.facts)
            except OSError as error:
                self.problem = error.strerror or str(error)
                return False
            self._kept, self.problem = sums.paths, ""
        if not self._named:
            disk_cache.prune(self.path.parent, CACHE_BYTES)
        return True

    def keep_beside(self, path: Path) -> bool:
        """Write the newest sums to another file, where theirs cannot be written; return whether that went well."""
        with self._lock, contextlib.suppress(OSError):
            write_sums(path, self.sums, self.facts)
            return True
        return False


def cached_path(facts: dict[str, str]) -> Path | None:
    """Return the file in the cache for what has these facts; None where the cache cannot be written."""
    folder = cache_dir("references")
    return None if folder is None else folder / contents.file_name(facts)


Progress = Callable[[float, str], object]


def nothing_told(part: float, detail: str) -> None:
    """Ignore what is told of progress."""


def trace(
    task: Task,
    keeper: Keeper,
    error: float,
    paths: int,
    progress: Progress = nothing_told,
    device: Any = None,
) -> float:
    """Trace until the estimated error is at most `error`, or another block would exceed `paths` of each pixel.

    The sums are in `keeper`, which writes them now and then, and at the end, however that comes. Return the estimated
    error. Nothing is opened where the sums suffice. `device` is one of `chapters.open` to share, or None.
    """
    found = judged(keeper.sums, task.exposure)
    pixels = task.size[0] * task.size[1]
    if found <= error or keeper.sums.paths + block_after(keeper.sums.paths, pixels) > paths:
        return keeper.sums.error(task.exposure) if keeper.sums.paths else 1.0
    try:
        with opened(task, tiles_of(task.size)[0].size, device) as renderer:
            _trace(renderer, task, keeper, device_name(renderer.capabilities), error, paths, progress)
    finally:
        keeper.keep()
    return keeper.sums.error(task.exposure)


def opened(task: Task, size: tuple[int, int], device: Any = None) -> Any:
    """Return a renderer for tiles of a task; `device` is one of `chapters.open` to share, or None."""
    return chapters.open(
        TRACER,
        task.backend,
        scene=task.scene,
        size=size,
        settings=replaced(task.settings, path_samples=1),
        outputs={"path_sums", "path_squares"},
        **({} if device is None else {"device": device}),
    )


Job = tuple[Tile, int, int]
"""A tile, the number of its first path, and how many paths of each pixel."""


def blocks_of(renderer: Any, task: Task, jobs: Iterable[Job]) -> Iterator[tuple[Float32, Float32]]:
    """Yield the sums of the paths of each job, of each pixel of its tile.

    Of light (h, w, 4), and of squares (h, w, 2), as the path tracer's images have them; they are valid until the next
    ones are asked for. The GPU traces the next job while those of one are read and merged.
    """
    knobs, before = renderer.settings.paths, None
    for tile, first, count in jobs:
        knobs.path_first, knobs.path_samples = first, count
        technique = renderer.techniques["paths"]
        technique.crop = (*tile.first, *task.size)
        technique.reset(
            "another block"
        )  # else a frame that shows what the one before shows has the next paths
        frame = renderer.render(task.view, task.time)
        if before is not None:
            yield _sums_of(before)
        before = frame
    if before is not None:
        yield _sums_of(before)


def _sums_of(frame: Any) -> tuple[Float32, Float32]:
    return frame.image("path_sums"), frame.image("path_squares")[..., :2]


def device_name(capabilities: Any) -> str:
    """Return what the bits of sums depend on: device and driver, and of a software driver the processor's features."""
    name = f"{capabilities.device} ({capabilities.driver})"
    return f"{name}, processor {cpu_features()}" if capabilities.is_software else name


@cache
def cpu_features() -> str:
    """Return a short hash of the features for which a software driver compiles; of the processor's name elsewhere."""
    text = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
        found = next((line for line in lines if line.lower().startswith(("flags", "features"))), "")
        words = found.partition(":")[2].split()
        text = " ".join(sorted({word for word in words if word.startswith(VECTORS)})) or text
    return hashlib.blake2b(text.encode(), digest_size=4).hexdigest()


def _trace(
    renderer: Any, task: Task, keeper: Keeper, device: str, error: float, paths: int, progress: Progress
) -> None:
    pixels, tiles = task.size[0] * task.size[1], tiles_of(task.size)
    speed, told = _Speed(keeper.sums.paths), (0.0, "")

    def tile_done(tile: Tile) -> None:
        if tiles[1:]:
            progress(told[0], f"{told[1]}, tile {tile.number + 1} of {len(tiles)}".removeprefix(", "))

    next_keep = clock.perf_counter() + KEEP_EVERY_S
    while (first := keeper.sums.paths) + (count := block_after(first, pixels)) <= paths:
        blocks = blocks_of(renderer, task, ((tile, first, count) for tile in tiles))
        block = merged(tiles, task.size, blocks, tile_done)
        # In one step: an interruption finds the sums before or after a block.
        keeper.sums = keeper.sums.plus(*block, count, device)
        found = judged(keeper.sums, task.exposure)
        if found <= error:
            return
        speed.passed(keeper.sums.paths)
        told = speed.told(found, error, paths)
        progress(*told)
        now = clock.perf_counter()
        if now >= next_keep:
            keeper.keep()
            taken = clock.perf_counter() - now
            next_keep = now + max(KEEP_EVERY_S, 10.0 * taken)


def judged(sums: Sums, scale: float) -> float:
    """Return the estimated error where it is time for it, else infinity; `scale` is the factor from nits."""
    return sums.error(scale) if is_judged(sums.paths) else float("inf")


class _Speed:
    """Paths a second, and from it the time that is left: the error falls with the root of the number of paths."""

    def __init__(self, paths: int) -> None:
        self._first, self._paths = paths, paths
        self._began: float | None = None
        self._error = float("inf")

    def passed(self, paths: int) -> None:
        """Note that there are so many paths of each pixel; the first block, in which drivers compile, has no time."""
        if self._began is None:
            self._first, self._began = paths, clock.perf_counter()
        self._paths = paths

    def told(self, found: float, goal: float, most: int) -> tuple[float, str]:
        """Return the part of the whole that is behind, and a text with paths, error and the time left."""
        self._error = found if np.isfinite(found) else self._error
        text = f"{self._paths} paths a pixel"
        if not np.isfinite(self._error):
            return 0.0, text
        needed = min(self._paths * (self._error / goal) ** 2 if goal > 0.0 else np.inf, float(most))
        text += f", estimated error {self._error:.2g}"
        since = 0.0 if self._began is None else clock.perf_counter() - self._began
        if self._paths > self._first:
            text += (
                f", about {spoken_time((needed - self._paths) * since / (self._paths - self._first))} left"
            )
        return min(self._paths / max(needed, 1.0), 1.0), text


def spoken_time(seconds: float) -> str:
    """Return a length of time in one unit: "40 s", "12 min", "3.5 h"."""
    seconds = max(seconds, 0.0)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def task_of(
    settings: Any,
    scene: Scene,
    camera: View | str | None,
    size: tuple[int, int],
    time: float,
    backend: str,
) -> Task:
    """Return what to trace with the `settings` of the path tracer. Raises UserError for a scene of nothing."""
    if not len(scene.indices):
        raise UserError(f"{scene.name} has no triangles: there is nothing to trace.")
    if isinstance(camera, View):
        view = camera
    else:
        view = view_of_scene(scene, evaluate_pose(scene, time), camera, size[0] / size[1])
    return Task(scene, view, time, size, chapters.choose_backend(backend, TRACER), settings)


def check_goal(error: float, paths: int, filter: str, seed: int) -> None:
    """Raise UserError for an error, a number of paths, a filter or a seed that means nothing."""
    if not 0.0 <= error <= 1.0:
        raise UserError(f"--error {error:g} is no relative error: give a number from 0 to 1, such as 0.01.")
    if not 1 <= paths <= MOST_PATHS:
        raise UserError(f"--paths {paths} is no number of paths: give one from 1 to {MOST_PATHS}.")
    if filter not in FILTERS:
        raise UserError(f"There is no filter {filter!r}: write {' or '.join(FILTERS)}.")
    if not 0 <= seed <= MOST_SEED:
        raise UserError(f"--seed {seed} is no seed: give a whole number from 0 to {MOST_SEED}.")


def check_room(size: tuple[int, int]) -> None:
    """Raise UserError for a picture whose sums cannot be held in memory."""
    width, height = size
    needed, free = BYTES_OF_PIXEL * width * height, free_memory()
    if free is not None and needed > free:
        raise UserError(
            f"A reference of {width}x{height} pixels is too large: its sums take {needed / 2**30:.1f} GiB of memory, "
            f"and {free / 2**30:.1f} GiB are free. A smaller --size needs less."
        )


def reference(
    chapter: int | str | Path | Folder,
    scene: Scene,
    camera: View | str | None = None,
    size: tuple[int, int] = (640, 360),
    error: float = 0.01,
    *,
    paths: int = DEFAULT_PATHS,
    filter: str = "box",
    seed: int = 0,
    time: float = 0.0,
    backend: str = "auto",
    settings: Any = None,
    overrides: Iterable[str] = (),
    cached: bool = True,
    progress: Progress = nothing_told,
    device: Any = None,
) -> tuple[Float32, float]:
    """Return the reference picture (H, W, 3) float32 in nits of a chapter's scene, and its estimated relative error.

    `settings` are the chapter's (None: its preset `reference`), of which what says anything about light is taken;
    `overrides` are texts "key=value" as for --set. `camera` is a view, or what `view_of_scene` takes. The error is the
    root of the mean squared relative standard error of pixels; it is at most `error` unless `paths` paths of each pixel
    were too few. `device` is one of `chapters.open` to share, or None. Raises UserError for a wrong argument,
    UnsupportedError where this machine cannot do it.
    """
    check_goal(error, paths, filter, seed)
    check_room(size)
    chosen, of_paths = chapter_settings(chapters.parse_chapter(chapter), overrides)
    settings = tracer_settings(chosen if settings is None else settings, filter, seed, of_paths)
    task = task_of(settings, scene, camera, size, time, backend)
    facts = task.facts()
    keeper = Keeper(cached_path(facts) if cached else None, facts, size)
    found = trace(task, keeper, error, paths, progress, device)
    return keeper.sums.picture, found
