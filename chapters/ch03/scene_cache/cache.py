"""Scenes that are opened faster the second time: what loading gave is kept in one file, and mapped from then on.

Nothing in a cache is believed because it is there. Its name stands for the scene's path, what it says of itself for the
program that wrote it, its checksums for its bytes, and the record of its sources for their content. Whatever does not
fit makes it worthless: the scene is loaded from its source as if there were no cache, and a new one is written.

The first load does not wait for that either. Geometry is written at once; each picture when it is decoded, by the
thread that decoded it for the screen. Only block compression, which is much more work than decoding, runs by itself.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import SceneError, UnsupportedError
from common.files.disk_cache import mark_read, prune
from common.gltf import load_scene
from common.gltf.load import Progress
from common.images import blocks
from common.paths import cache_dir, matched, user_cache
from common.scene import EncodedImage, Image, Scene
from common.scene.images import Pixels

from ..loading.loading import beside_geometry, threads_at_most
from ..scene.material_types import index_offsets, material_ranges, mesh_ranges
from . import sources as scene_sources
from .images import CachedImage, Source, chain_record, compress, image_uses, is_compressible
from .records import put_together, take_apart
from .sections import DamagedError, SectionFile, SectionWriter

FOLDER = "scene-cache"
MOST_BYTES = 8 * 2**30
"""Of all caches together; those that were read longest ago go first."""

VERSION = 1
"""What changes a cache and none of the files below."""

_MAKERS = (
    "common/gltf/**/*.py",
    "common/scene/scene.py",
    "common/scene/images.py",
    "common/images/blocks.py",
    "common/images/mips.py",
)
_PARTS = (
    "scene_cache/cache.py",
    "scene_cache/records.py",
    "scene_cache/images.py",
    "scene_cache/sections.py",
    "scene/material_types.py",
    "scene/textures/reads.py",
    "scene/textures/texels.py",
)


class CacheMiss(Exception):
    """There is no cache that can be used; the text says why, as the end of a sentence."""


@dataclass
class Opened:
    """A scene, how it was opened as a sentence, and where it is still to be cached, what does that."""

    scene: Scene
    told: str
    writer: Writer | None = None


def open_scene(
    path: Path, progress: Progress | None = None, cached: bool = True, compressed: bool = False
) -> Opened:
    """Open the scene of a .gltf or .glb file: from its cache where that is whole and fits, else from the file itself.

    Its images are decoded when they are asked for. `compressed` chooses a cache with block-compressed textures; not
    `cached`, none is read or written. Raises SceneError as `load_scene` does, UnsupportedError where
    nothing can compress; nothing that is wrong with a cache raises.
    """
    began = time.perf_counter()
    if not cached:
        scene = load_scene(path, progress, decode=False, ahead=beside_geometry())
        return Opened(scene, f"loaded {path.name} {_since(began)}, without a cache")
    target = cache_file(path, compressed)
    try:
        scene = read_cache(target, path, compressed)
        if progress is not None:
            progress(1.0, "mapped")
        return Opened(scene, f"opened {path.name} {_since(began)} from its cache {target.name}")
    except CacheMiss as miss:
        why = str(miss)
    if compressed and (lack := blocks.lack()):
        raise UnsupportedError(
            f"A compressed cache needs the package etcpak, which {lack}: run `pip install etcpak`, or cache the scene "
            "uncompressed."
        )
    states = {path.name: scene_sources.state_of(path)}

    def opened(name: str) -> None:
        """Keep the state of a source before it is opened: a change meanwhile is seen, and no other file is hashed."""
        states.setdefault(name, scene_sources.state_of(path.parent / name, path.parent))

    scene = load_scene(path, progress, decode=False, ahead=beside_geometry(), opened=opened)
    told = f"loaded {path.name} {_since(began)}, since {why}"
    if cache_dir(FOLDER) is None:
        return Opened(scene, told)
    try:
        return Opened(scene, told, Writer(scene, target, path, states, compressed))
    except (OSError, ValueError, TypeError, RecursionError) as error:
        scene.warnings.append(_not_written(error))
        return Opened(scene, told)


def _since(began: float) -> str:
    return f"in {(time.perf_counter() - began) * 1e3:.0f} ms"


def _not_written(error: BaseException) -> str:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else error
    return f"No cache of the scene was written ({reason}): it will take as long to load the next time."


def cache_file(path: Path, compressed: bool = False) -> Path:
    """Return where the cache of a scene is or would be; the folder may be missing."""
    name = hashlib.sha256(_place(path).encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return user_cache() / FOLDER / f"{name}.{'blocks' if compressed else 'texels'}"


def _place(path: Path) -> str:
    return os.path.realpath(path)


@cache
def maker() -> str:
    """Return a hash of the program that makes scenes and caches of them: a cache of another one is stale.

    Packages are not asked: what an older decoder or encoder made of a picture is not wrong by that.
    """
    found = hashlib.sha256(str(VERSION).encode())
    for file in (*matched(_PARTS, Path(__file__).parents[1]), *matched(_MAKERS)):
        found.update(file.name.encode() + file.read_bytes())
    return found.hexdigest()


# --- reading ----------------------------------------------------------------------------------------------------------


def read_cache(target: Path, path: Path, compressed: bool = False) -> Scene:
    """Return the scene of `path` from its cache. Raises CacheMiss: there is none, or none that can be trusted."""
    opened: list[Scene] = []

    def damaged(error: DamagedError) -> None:
        with contextlib.suppress(OSError):
            target.unlink(missing_ok=True)
        for scene in opened:
            scene.warnings.append(
                f"The cache of the scene {error}: it was removed, and its file read instead."
            )

    try:
        file = SectionFile(target)
        about = file.about
        if (about["maker"], about["path"], about["compressed"]) != (maker(), _place(path), compressed):
            raise CacheMiss("its cache is of another version or another file")
        if not scene_sources.same(path.parent, json.loads(about["sources"])):
            raise CacheMiss("its files changed since it was cached")
        source = Source(path)
        records = enumerate(json.loads(about["images"]))
        images: list[Image] = [
            CachedImage(file, number, record, source, damaged) for number, record in records
        ]
        scene = put_together(about["scene"], file.array, images, path)
        if not same_types(sorted_types(scene), about["types"]):
            raise CacheMiss("its cache has other material types than it")
    except FileNotFoundError:
        raise CacheMiss("it had no cache") from None
    except OSError as error:
        raise CacheMiss(f"its cache cannot be read ({error.strerror or error})") from None
    except DamagedError as error:
        raise CacheMiss(f"its cache {error}") from None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise CacheMiss(f"its cache makes no sense ({error})") from None
    opened.append(scene)
    mark_read(target)
    return scene


def sorted_types(scene: Scene) -> dict[str, np.ndarray[Any, Any]]:
    """Return the scene's materials, meshes and indices by material type: orders, and offsets of M + 1 entries."""
    materials, meshes = material_ranges(scene), mesh_ranges(scene)
    return {
        "materials": materials.order,
        "material_offsets": materials.offsets,
        "meshes": meshes.order,
        "mesh_offsets": meshes.offsets,
        "index_offsets": index_offsets(scene, meshes),
    }


def same_types(one: dict[str, np.ndarray[Any, Any]], other: dict[str, np.ndarray[Any, Any]]) -> bool:
    """Whether both say the same."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


# --- writing ----------------------------------------------------------------------------------------------------------


class Writer:
    """Writes the cache of a scene while others decode its images, or by itself; nobody sees it before it is whole.

    `finish` does what is left and waits, `start` has a thread do so where nobody else would, `stop` gives up. What goes
    wrong is no error: `told` says how it ended, as a sentence, and `failed` whether the user should hear of it.
    """

    def __init__(
        self, scene: Scene, target: Path, path: Path, states: dict[str, scene_sources.State], compressed: bool
    ) -> None:
        """Write all but the images, and watch those. Raises OSError where that cannot be written."""
        self.told, self.failed = "", False
        self._target, self._folder, self._states = target, path.parent, states
        self._compressed = compressed
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None
        self._ending: threading.Thread | None = None
        self._plain = list(scene.images)
        self._uses = image_uses(scene)
        self._unclaimed, self._missing = set(self._uses), len(self._uses)
        self._records: list[dict[str, Any]] = [
            {
                "name": image.name,
                "size": [image.width, image.height],
                "dtype": image.dtype.str,
                "pixels": None,
                "chains": [],
            }
            for image in scene.images
        ]
        self._file = SectionWriter(target)
        try:
            self._about: dict[str, Any] = {
                "maker": maker(),
                "path": _place(path),
                "compressed": compressed,
                "scene": take_apart(scene, self._file.add),
                "types": sorted_types(scene),
            }
        except BaseException:
            self._file.drop()
            raise
        scene.images[:] = [
            EncodedImage(one.name, (one.width, one.height), one.dtype.type, partial(self._decode, number))
            for number, one in enumerate(self._plain)
        ]

    def finish(self, progress: Progress | None = None) -> str:
        """Decode what nobody asked for yet, wait until the file is in its place, and return how that ended."""
        with self._lock:
            left = sorted(self._unclaimed)
        if not self._uses:
            self._end()

        def one(number: int) -> None:
            if not self._over.is_set() and number in self._unclaimed:
                self._keep(number, self._plain[number].decode())
            if progress is not None:
                progress(1.0 - self._missing / len(self._uses), "caching images")

        try:
            with ThreadPoolExecutor(threads_at_most(), thread_name_prefix="cache-image") as pool:
                list(pool.map(one, left))
        except (SceneError, MemoryError) as error:  # who draws the picture is told of it
            self._fail(f"The scene is not cached: {error}", failed=False)
        except BaseException as error:  # a mistake: what waits for the file must not wait for ever
            self._fail(_not_written(error))
            raise
        self._over.wait()  # for what other threads have begun to write
        self._join_ending()
        return self.told

    def start(self) -> None:
        """Let a thread finish where nobody else will: to compress images, or where there are none."""
        if self._compressed or not self._missing:
            self._thread = threading.Thread(target=self.finish, name="scene-cache", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Give up what is not whole yet, and wait for the threads."""
        self._join_ending()
        self._fail("It was closed before all of its images were there, and is not cached.", failed=False)
        if self._thread is not None:
            self._thread.join()

    def _join_ending(self) -> None:
        with self._lock:
            ending = self._ending
        if ending is not None:
            ending.join()

    def _decode(self, number: int) -> Pixels:
        """Decode an image for whoever asked, and keep what that gave."""
        pixels = self._plain[number].decode()
        if not self._compressed:
            self._keep(number, pixels)
        return pixels

    def _keep(self, number: int, pixels: Pixels) -> None:
        """Write an image unless somebody does already; with the last of them the file is whole."""
        with self._lock:
            if number not in self._unclaimed or self._over.is_set():
                return
            self._unclaimed.discard(number)
        record = self._records[number]
        try:
            if self._compressed and is_compressible(self._plain[number]):
                for use in self._uses[number]:
                    record["chains"].append(chain_record(use, compress(pixels, use), self._file.add))
            else:
                record["pixels"] = self._file.add(pixels)
        except (OSError, ValueError, UnsupportedError) as error:  # ValueError: it was given up meanwhile
            self._fail(_not_written(error))
            return
        except BaseException as error:
            self._fail(_not_written(error))
            raise
        with self._lock:
            self._missing -= 1
            if not self._missing:
                # Not here: the sources are hashed, and somebody waits for the pixels.
                self._ending = threading.Thread(target=self._end, name="scene-cache-end", daemon=True)
                self._ending.start()

    def _end(self) -> None:
        """Put the file in its place, if what it was made of is still there."""
        try:
            sources = scene_sources.record(self._folder, self._states)
            texts = {"sources": json.dumps(sources), "images": json.dumps(self._records)}
            with self._lock:
                if self._over.is_set():
                    return
                size = self._file.keep(self._about | texts)
                self.told = f"It is cached in {self._target}, {size / 1e6:.1f} MB."
                self._over.set()
        except (OSError, ValueError, MemoryError) as error:
            self._fail(_not_written(error))
            return
        except BaseException as error:
            self._fail(_not_written(error))
            raise
        prune(self._target.parent, MOST_BYTES)

    def _fail(self, why: str, failed: bool = True) -> None:
        """Remove what was written, unless the file is in its place already."""
        with self._lock:
            if not self._over.is_set():
                self.told, self.failed = why, failed
                self._file.drop()
                self._over.set()
