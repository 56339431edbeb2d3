"""Draws prepared by several threads: each turns some of them into a list of calls, the context's thread makes them.

A context belongs to one thread, so no other thread may call OpenGL. The threads can share only the preparation of the
calls; compare frames/recording/vulkan_secondaries.py, where every thread calls the driver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context

from ...pipelines.description import Built, Front
from ...pipelines.gl import Pipelines
from ...tasks.scheduler import split
from ...tasks.workers import ALONE, Workers
from ..commands import DrawGroup, SceneBinding
from ..gl import FrameSlot
from ..gl_commands import Commands
from ..settings import FrameSettings
from .parts import Groups, part_count


def open_commands(
    context: Context, pipelines: Pipelines, multi_draw: bool, workers: Workers, settings: FrameSettings
) -> Commands:
    """Return the commands of the renderer; if there are workers, they prepare the calls."""
    if workers.count == 0:
        return Commands(context, pipelines, multi_draw)
    return ParallelCommands(context, pipelines, multi_draw, workers, settings.draws_per_secondary)


class CallList:
    """Replaces a context: it stores the calls of its `fn`, to be made later on the context's thread."""

    def __init__(self) -> None:
        self.fn = self
        self.calls: list[tuple[str | Callable[..., None], tuple[Any, ...]]] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        if not name.startswith("gl"):
            raise AttributeError(name)
        # By its name: only the context's thread may look up the address of a function.
        return lambda *arguments: self.calls.append((name, arguments))

    def make(self, fn: gl.Functions) -> None:
        """Make all calls in order."""
        for call, arguments in self.calls:
            (getattr(fn, call) if isinstance(call, str) else call)(*arguments)


class ListedCommands(Commands):
    """Writes the calls of some draws into a list, and counts them."""

    def __init__(self, pipelines: Pipelines, multi_draw: bool, slot: FrameSlot) -> None:
        self.list = CallList()
        listed: Any = self.list
        super().__init__(listed, pipelines, multi_draw)
        self.begin(slot)

    def bind_pipeline(self, pipeline: Built, cull: bool = False, front: Front = "counter_clockwise") -> None:
        """Store the call of `Pipelines.bind`, which calls OpenGL itself."""
        self.list.calls.append((self._pipelines.bind, (pipeline, cull, front)))
        self.work["pipeline_binds"] += 1


class ParallelCommands(Commands):
    """Makes calls as `Commands` does, but several threads prepare the calls of groups of draws."""

    def __init__(
        self, context: Context, pipelines: Pipelines, multi_draw: bool, workers: Workers, least_calls: int
    ) -> None:
        super().__init__(context, pipelines, multi_draw)
        self._workers, self._least = workers, least_calls

    def begin(self, slot: FrameSlot) -> None:
        """Start a frame in `slot`, with all counters at zero."""
        super().begin(slot)
        self.work |= ALONE

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order; with enough calls, all threads prepare them as lists first.

        Raises TaskError if a list could not be made, after all threads have stopped.
        """
        numbered_groups = Groups(groups, self._multi_draw)
        parts = part_count(numbered_groups.end, self._least)
        if not parts:
            super().draw_groups(groups, scene)
            return
        listed: dict[int, ListedCommands] = {}

        def write(first: int, last: int, thread: int) -> None:
            commands = ListedCommands(self._pipelines, self._multi_draw, self.slot)
            commands.draw_groups(numbered_groups.part(first, last), scene)
            listed[first] = commands

        self._workers.share("list draws", write, numbered_groups.end, parts)
        for first, _ in split(numbered_groups.end, parts):
            listed[first].list.make(self._context.fn)
            for name, number in listed[first].work.items():
                self.work[name] += number
        self.work["recorded_parts"] += parts
        self.work["recording_threads"] = 1 + self._workers.count
