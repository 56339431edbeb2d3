"""Opening what `strata run` draws: through the cache of the scene where the chapter has one, else as it is loaded."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import chapters
from chapters import scenes, studies
from common.errors import UserError
from tools.cli.console import say

if TYPE_CHECKING:
    from common.scene import Scene

CACHE = "scene_cache/cache.py"
"""The module of a chapter that keeps scenes: it has `open_scene`."""


@dataclass
class Opening:
    """A scene that is drawn; on leaving, what is still being written to its cache is given up."""

    scene: Scene
    told: str = ""
    """How the scene was opened, as a sentence; "" where there is nothing to say."""
    writer: Any = None
    """What writes the cache, see `Writer` in that module; None where there is nothing to write."""

    def __enter__(self) -> Opening:
        return self

    def __exit__(self, *_: object) -> None:
        if self.writer is not None:
            self.writer.stop()

    def start(self) -> None:
        """Have the cache written beside what goes on, where that is nobody else's work."""
        if self.writer is not None:
            self.writer.start()

    def finish(self, progress: Any = None) -> None:
        """Write what is left of the cache."""
        if self.writer is not None:
            self.writer.finish(progress)

    def report(self, verbose: bool) -> None:
        """Say how the scene came here and how writing its cache ended: where that failed, or if `verbose`."""
        if verbose and self.told:
            say(f"strata: {self.told}.")
        if self.writer is not None and self.writer.told and (verbose or self.writer.failed):
            say(f"strata: {self.writer.told}")


def open_scene(
    which: chapters.Which,
    text: str | None,
    progress: Any = None,
    around: str = "none",
    cached: bool = True,
    compressed: bool = False,
) -> Opening:
    """Open what is to be drawn: the scene meant by `text`, else that of `which`, in the environment `around`.

    Where the chapter keeps scenes and unless not `cached`, a glTF file comes from its cache, or is cached. With
    `compressed`, that cache has block-compressed textures. Raises UserError as `studies.load` does, and where
    there is no cache to compress.
    """
    keeps = not isinstance(which, str) and (chapters.folder_of(which) / CACHE).is_file()
    if compressed and not cached:
        raise UserError("--compress and --no-cache cannot both be meant: leave one out.")
    if compressed and not keeps:
        raise UserError(f"{studies.spoken(which)} keeps no scenes: leave --compress out.")
    if isinstance(which, str) or not keeps:
        return Opening(studies.load(which, text, progress, around))
    path, far = scenes.named(scenes.DEFAULT if text is None else text, around)
    if path.suffix.lower() == ".obj":
        return Opening(studies.load(which, text, progress, around))
    module = import_module(f"{chapters.package_of(which)}.scene_cache.cache")
    opened = module.open_scene(path, progress, cached, compressed)
    return Opening(scenes.surrounded(opened.scene, far), opened.told, opened.writer)
