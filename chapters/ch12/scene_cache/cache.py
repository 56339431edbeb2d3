"""The scene cache: the result of loading a scene in one file, which is mapped when the scene is opened again.

A cache is used only if four things match: its name (the path of the scene), the hash of the program that wrote it, the
checksums of its bytes, and the record of its source files. Otherwise the scene is loaded from its source, and a new
cache is written.

The first load does not wait for the cache. Geometry is written at once; each picture when it is decoded, by the thread
that decoded it for the screen. Only block compression runs separately, since it is much slower than decoding.
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
from ..meshlets.scene import begin_meshlets, keep_no_levels
from ..scene.material_types import index_offsets, material_ranges, mesh_ranges
from . import sources as scene_sources
from .images import CachedImage, Source, chain_record, compress, image_uses, is_compressible
from .meshlets import read_meshlets, store_meshlets
from .records import put_together, take_apart
from .sections import DamagedError, SectionFile, SectionWriter

FOLDER = "scene-cache"
MOST_BYTES = 8 * 2**30
"""The limit of all caches together; the least recently used ones are removed first."""

VERSION = 1
"""The version of the format: counts changes that are in none of the files below."""

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
    "scene_cache/meshlets.py",
    "scene_cache/sections.py",
    "meshlets/*.py",
    "cloth/fields.py",
    "scene/material_types.py",
    "scene/textures/reads.py",
    "scene/textures/texels.py",
)


class CacheMiss(Exception):
    """There is no valid cache; the text is the reason, as the end of a sentence."""


@dataclass
class Opened:
    """A scene, a sentence on how it was opened, and the writer of its cache if one is being written."""

    scene: Scene
    told: str
    writer: Writer | None = None


def open_scene(
    path: Path, progress: Progress | None = None, cached: bool = True, compressed: bool = False
) -> Opened:
    """Open the scene of a .gltf or .glb file: from its cache if that is valid, else from the file itself.

    Images are decoded at their first use. `compressed` selects a cache with block-compressed textures; without `cached`
    no cache is read or written. Raises SceneError as `load_scene` does, and UnsupportedError if there is no encoder. A
    faulty cache raises nothing.
    """
    began = time.perf_counter()
    if not cached:
        scene = load_scene(path, progress, decode=False, ahead=beside_geometry())
        begin_meshlets(scene)
        keep_no_levels(scene)
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
        """Store the state of a source before it is opened, so that a later change is noticed."""
        states.setdefault(name, scene_sources.state_of(path.parent / name, path.parent))

    scene = load_scene(path, progress, decode=False, ahead=beside_geometry(), opened=opened)
    begin_meshlets(scene)
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
    """Return the path of the cache of a scene; file and folder may be missing."""
    name = hashlib.sha256(_place(path).encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return user_cache() / FOLDER / f"{name}.{'blocks' if compressed else 'texels'}"


def _place(path: Path) -> str:
    return os.path.realpath(path)


@cache
def maker() -> str:
    """Return a hash of the code that makes scenes and caches; a cache of other code is stale.

    Versions of packages do not count: the result of an older decoder or encoder is still valid.
    """
    digest = hashlib.sha256(str(VERSION).encode())
    for file in (*matched(_PARTS, Path(__file__).parents[1]), *matched(_MAKERS)):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


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
        read_meshlets(scene, about["meshlets"], file.array)
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


def same_types(a: dict[str, np.ndarray[Any, Any]], b: dict[str, np.ndarray[Any, Any]]) -> bool:
    """Whether both are equal."""
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


# --- writing ----------------------------------------------------------------------------------------------------------


class Writer:
    """Writes the cache of a scene while its images are decoded for other uses; it replaces the old file when complete.

    `finish` does the remaining work and waits, `start` lets a thread finish, `stop` gives up. A failure raises nothing:
    `told` is a sentence on the result, and `failed` says whether to show it to the user.
    """

    def __init__(
        self, scene: Scene, target: Path, path: Path, states: dict[str, scene_sources.State], compressed: bool
    ) -> None:
        """Write everything except images, and wait for their pixels. Raises OSError if writing fails."""
        self.told, self.failed = "", False
        self._target, self._folder, self._states = target, path.parent, states
        self._compressed = compressed
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None
        self._ending: threading.Thread | None = None
        self._plain = list(scene.images)
        self._meshlets = partial(store_meshlets, scene)
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
            EncodedImage(it.name, (it.width, it.height), it.dtype.type, partial(self._decode, number))
            for number, it in enumerate(self._plain)
        ]

    def finish(self, progress: Progress | None = None) -> str:
        """Decode the remaining images, wait until the file is complete, and return the sentence on the result."""
        with self._lock:
            left = sorted(self._unclaimed)
        if not self._uses:
            self._end()

        def decode(number: int) -> None:
            if not self._over.is_set() and number in self._unclaimed:
                self._keep(number, self._plain[number].decode())
            if progress is not None:
                progress(1.0 - self._missing / len(self._uses), "caching images")

        try:
            with ThreadPoolExecutor(threads_at_most(), thread_name_prefix="cache-image") as pool:
                list(pool.map(decode, left))
        except (SceneError, MemoryError) as error:  # the renderer gets the same error
            self._fail(f"The scene is not cached: {error}", failed=False)
        except BaseException as error:  # a mistake: what waits for the file must not wait for ever
            self._fail(_not_written(error))
            raise
        self._over.wait()  # for what other threads have begun to write
        self._join_ending()
        return self.told

    def start(self) -> None:
        """Let a thread finish if no decoder does: to compress images, or for a scene without images."""
        if self._compressed or not self._missing:
            self._thread = threading.Thread(target=self.finish, name="scene-cache", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Give up an incomplete cache, and wait for the threads."""
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
        """Decode an image for its user, and store the pixels."""
        pixels = self._plain[number].decode()
        if not self._compressed:
            self._keep(number, pixels)
        return pixels

    def _keep(self, number: int, pixels: Pixels) -> None:
        """Write an image unless another thread does; the last image completes the file."""
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
                # On another thread: hashing the sources takes time, and this thread has pixels to return.
                self._ending = threading.Thread(target=self._end, name="scene-cache-end", daemon=True)
                self._ending.start()

    def _end(self) -> None:
        """Move the file to its place if its sources are unchanged."""
        try:
            sources = scene_sources.record(self._folder, self._states)
            texts = {"sources": json.dumps(sources), "images": json.dumps(self._records)}
            self._about["meshlets"] = self._meshlets(self._file.add)
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
        """Remove an incomplete file."""
        with self._lock:
            if not self._over.is_set():
                self.told, self.failed = why, failed
                self._file.drop()
                self._over.set()
