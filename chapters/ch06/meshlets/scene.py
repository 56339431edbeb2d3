"""The meshlets of an opened scene: built once, or read from its cache, and shared by all renderers of the scene."""

from __future__ import annotations

import threading
import weakref
from contextlib import suppress
from functools import partial

from common.errors import StrataError
from common.scene import Scene

from .build import build_meshlets
from .model import SceneMeshlets


class _Entry:
    """The meshlets of one scene. The first thread that asks builds them, and others wait for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.meshlets: SceneMeshlets | None = None

    def get(self, scene: Scene) -> SceneMeshlets:
        """Return the meshlets. Raises as `build_meshlets` does."""
        with self._lock:
            if self.meshlets is None:
                self.meshlets = build_meshlets(scene)
            return self.meshlets


_ENTRIES: dict[int, _Entry] = {}
"""By the identity of the scene, since scenes that are equal are not the same; an entry goes with its scene."""
_ENTRIES_LOCK = threading.Lock()


def meshlets_of(scene: Scene) -> SceneMeshlets:
    """Return the meshlets of a scene; a build that another thread has begun is waited for.

    Raises:
        SceneError: the scene is too large, see `build_meshlets`.
    """
    return _entry(scene).get(scene)


def begin_meshlets(scene: Scene) -> None:
    """Let a thread build the meshlets of a scene, beside whatever else is loaded."""
    threading.Thread(target=_build, args=(_entry(scene), scene), name="meshlets", daemon=True).start()


def keep_meshlets(scene: Scene, meshlets: SceneMeshlets) -> None:
    """Set the meshlets of a scene: those of its cache, or of other limits than the usual ones."""
    _entry(scene).meshlets = meshlets


def _build(entry: _Entry, scene: Scene) -> None:
    with suppress(StrataError, MemoryError):  # raised again by `meshlets_of`
        entry.get(scene)


def _entry(scene: Scene) -> _Entry:
    with _ENTRIES_LOCK:
        entry = _ENTRIES.get(id(scene))
        if entry is None:
            entry = _ENTRIES[id(scene)] = _Entry()
            weakref.finalize(scene, partial(_ENTRIES.pop, id(scene), None)).atexit = False
        return entry
