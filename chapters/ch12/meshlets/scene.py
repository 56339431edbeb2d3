"""The meshlets and levels of an opened scene: made once, or read from a cache, and shared by all its renderers."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Generic, TypeVar

from common.errors import StrataError
from common.scene import Scene

from .build import build_meshlets
from .lods import SceneLevels, with_levels
from .model import SceneMeshlets

T = TypeVar("T")


class _Entry(Generic[T]):
    """What belongs to one scene. The first thread that asks makes it, and others wait for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.made: T | None = None

    def get(self, make: Callable[[Scene], T], scene: Scene) -> T:
        """Return what `make` returns for the scene, made once. Raises as `make` does."""
        with self._lock:
            if self.made is None:
                self.made = make(scene)
            return self.made


class _ByScene(Generic[T]):
    """Entries by the identity of scenes, since scenes that are equal are not the same; an entry goes with its scene."""

    def __init__(self) -> None:
        self._entries: dict[int, _Entry[T]] = {}
        self._lock = threading.Lock()

    def __getitem__(self, scene: Scene) -> _Entry[T]:
        with self._lock:
            entry = self._entries.get(id(scene))
            if entry is None:
                entry = self._entries[id(scene)] = _Entry()
                weakref.finalize(scene, partial(self._entries.pop, id(scene), None)).atexit = False
            return entry


_MESHLETS: _ByScene[SceneMeshlets] = _ByScene()
_LEVELS: _ByScene[SceneLevels] = _ByScene()
_UNKEPT: _ByScene[bool] = _ByScene()


def meshlets_of(scene: Scene) -> SceneMeshlets:
    """Return the meshlets of a scene; a build that another thread has begun is waited for.

    Raises:
        SceneError: the scene is too large, see `build_meshlets`.
    """
    return _MESHLETS[scene].get(build_meshlets, scene)


def levels_of(scene: Scene) -> SceneLevels:
    """Return the levels of detail of a scene's meshes.

    Raises:
        UserError: levels are not in the cache, and the package `meshoptimizer` is not installed.
    """
    return _LEVELS[scene].get(partial(with_levels, kept=not _UNKEPT[scene].made), scene)


def keep_no_levels(scene: Scene) -> None:
    """Let the levels of a scene be neither read from the user's cache nor kept there."""
    _UNKEPT[scene].made = True


def begin_meshlets(scene: Scene) -> None:
    """Let a thread build the meshlets of a scene, beside whatever else is loaded."""
    threading.Thread(target=_build, args=(scene,), name="meshlets", daemon=True).start()


def keep_meshlets(scene: Scene, meshlets: SceneMeshlets) -> None:
    """Set the meshlets of a scene: those of its cache, or of other limits than the usual ones."""
    _MESHLETS[scene].made = meshlets


def _build(scene: Scene) -> None:
    with suppress(StrataError, MemoryError):  # raised again by `meshlets_of`
        meshlets_of(scene)
