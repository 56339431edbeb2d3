"""Shaders that are edited while they run: a saved file is noticed, and the pipelines that use it are built anew.

    with Live() as live:
        renderer = chapters.open(...)
        while True:
            if live.follow(renderer):
                print(live.message)
            renderer.render(view, time)

A shader that is wrong changes nothing: the renderer goes on with the last good ones, and so does every pipeline and
every renderer that is made meanwhile (`shader_files.pinned`). The file of a frame graph is followed like them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from backends.contract import Reloaded
from backends.shader_text import STAGES
from backends.vulkan.shaders.live import check_alone, compiled_alone
from common.errors import ShaderError, StrataError
from common.files import shader_files
from common.files.shader_files import State, shown_path
from tools.cli.console import say

if TYPE_CHECKING:
    from backends.contract import Renderer

POLL_S = 0.05
"""How often files are looked at."""

SETTLED_S = 0.05
"""A file that was not written for so long is whole: editors write in several steps."""

RETURNS_S = 0.5
"""The same for a file that is empty or gone, which between two steps of saving it often is."""

ALL = ("all",)
"""What a renderer has built anew that was opened anew."""


class Watcher:
    """Notices which of some files changed, once they have stopped changing."""

    def __init__(self, timer: Callable[[], float] = clock.monotonic) -> None:
        self._timer = timer
        self._known: dict[Path, State | None] = {}
        self._moving: dict[Path, tuple[State | None, float]] = {}  # since when a file is in its new state
        self._first: float | None = None
        self.noticed = 0.0
        """When the first of the changes that `poll` returned last was seen."""

    def watch(self, files: Collection[Path]) -> None:
        """Look at these files from here on, and at no other; also where there is none yet."""
        for path in self._known.keys() - files:
            del self._known[path]
            self._moving.pop(path, None)
        for path in files - self._known.keys():
            # Not as it is now: it may have been saved after its text was read.
            self._known[path] = shader_files.state_read(path)

    def poll(self) -> set[Path]:
        """Return the files that changed and are whole again, each change once."""
        now = self._timer()
        ready, waiting = set(), False
        for path, known in self._known.items():
            state = shader_files.state_of(path)
            if state == known:
                self._moving.pop(path, None)
                continue
            before, since = self._moving.get(path, (known, now))
            if before != state:
                self._moving[path] = state, now
                waiting = True
            elif now - since >= (SETTLED_S if state is not None and state.size else RETURNS_S):
                ready.add(path)
            else:
                waiting = True
        if self._moving and self._first is None:
            self._first = now
        if waiting and not any(now - self._moving[path][1] >= 2 * RETURNS_S for path in ready):
            return set()  # files that are saved together are taken together
        for path in ready:
            self._known[path] = self._moving.pop(path)[0]
        if ready and self._first is not None:
            self.noticed = self._first
        if not self._moving:
            self._first = None
        return ready


class Live:
    """Follows the shaders and the graph of one renderer after the other, as files. A context manager: opened before the
    first renderer."""

    def __init__(
        self, timer: Callable[[], float] = clock.monotonic, tell: Callable[[str], None] = say
    ) -> None:
        self._timer, self._tell = timer, tell
        self._watcher = Watcher(timer)
        self._due = -1e9
        self._waiting: frozenset[Path] = frozenset()  # changed files that no reload has taken yet
        self._needed: frozenset[Path] = frozenset()  # what may repair the shader that is wrong
        self._stack = ExitStack()
        self.error = ""
        """What is wrong with the shaders on disk, with file, line and caret; "" where they are those that run."""
        self.message = ""
        """What became of the last change."""
        self.rebuilt = 0
        """Pipelines that were built anew for it, and 1 more for another graph."""
        self.renderer: Renderer
        """The one to draw with after a change."""
        self.renew: Callable[[], Renderer] | None = None
        """Opens another renderer like the one followed and closes that; for studies, which cannot exchange shaders."""

    @property
    def noticed(self) -> float:
        """When the last change was first seen, on the timer."""
        return self._watcher.noticed

    def follow(self, renderer: Renderer) -> bool:
        """Look at the files, if it is time to, and let the renderer have those that changed; whether any did.

        Then `self.renderer` is the one to go on with.
        """
        now = self._timer()
        if now < self._due:
            return False
        self._due = now + POLL_S
        self._watch(renderer)
        changed = self._watcher.poll()
        if not changed:
            return False
        self.renderer, self.rebuilt = renderer, 0
        tried = self._waiting | changed
        began = clock.perf_counter()
        try:
            if renderer.shader_files:
                with shader_files.refreshed(tried):
                    done = renderer.reload_shaders(tried)
            else:
                done = self._open_anew(tried)
        except StrataError as error:
            self._waiting = tried
            self._needed = error.files if isinstance(error, ShaderError) else frozenset()
            self.error = str(error)
            kind = "shaders" if isinstance(error, ShaderError) else "graph"
            self.message = f"The picture is that of the last good {kind}."
            self._tell(f"strata: {error}\nstrata: the picture stays that of the last good {kind}.")
        else:
            self._waiting = self._needed = frozenset()
            self.error, self.rebuilt = "", len(done.pipelines) + done.graph
            self.message = _said(done, changed, clock.perf_counter() - began)
            if self.message:
                self._tell(f"strata: {self.message}")
        self._watch(self.renderer)  # at once: what is missing may come before the next look
        return True

    def _open_anew(self, changed: Collection[Path]) -> Reloaded:
        """Go on with another renderer, for one that builds its pipelines by itself."""
        # A driver may crash where a shader wants what no pipeline layout has; OpenGL has none.
        on_vulkan = self.renderer.capabilities.backend == "vulkan"
        alone = [path for path in shader_files.looked_for() if path.suffix.removeprefix(".") in STAGES]
        before = compiled_alone(alone) if on_vulkan else {}
        with shader_files.refreshed(changed):
            check_alone(before, changed)
            if self.renew is not None:
                self.renderer = self.renew()
        return Reloaded(ALL)

    def files(self, renderer: Renderer) -> frozenset[Path]:
        """Return the files that a renderer is followed by; all that were read where it names none."""
        return renderer.shader_files or shader_files.looked_for()

    def _watch(self, renderer: Renderer) -> None:
        self._watcher.watch(self.files(renderer) | self._needed | self._waiting)

    def __enter__(self) -> Live:
        self._stack.enter_context(shader_files.pinned())
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def _said(done: Reloaded, changed: Collection[Path], seconds: float) -> str:
    """Return what a reload did, in a sentence or two."""
    parts = []
    names = ", ".join(sorted({path.name for path in changed}))
    if done.graph:
        parts.append(f"{names}: another graph in {seconds * 1e3:.0f} ms.")
    if done.pipelines:
        count = len(done.pipelines)
        built = "1 pipeline" if count == 1 else f"{count} pipelines"
        built = "all pipelines" if done.pipelines is ALL else built
        parts.append(f"{names}: {built} built anew in {seconds * 1e3:.0f} ms.")
    elif not done.at_start and not done.graph:
        parts.append(f"{names}: the code of every pipeline is the same.")
    if done.at_start:
        names = ", ".join(shown_path(path) for path in sorted(done.at_start))
        verb = "runs" if len(done.at_start) == 1 else "run"
        parts.append(f"{names} {verb} when a scene is opened: start again to see the edit there.")
    return " ".join(parts)
