"""Draws prepared by several threads: each turns some of them into a list of calls, the context's thread makes them.

A context belongs to one thread, so no other may call OpenGL. What is left to share is to find out which calls there
are to be; compare frames/recording/vulkan_secondaries.py, where the driver is called by every thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context

from ...pipelines.description import Built, Front
from ...pipelines.gl import Pipelines
from ...settings import Settings
from ...tasks.scheduler import split
from ...tasks.workers import ALONE, Workers
from ..commands import DrawGroup, SceneBinding
from ..gl import FrameSlot
from ..gl_commands import Commands
from .parts import Groups, part_count


def open_commands(
    context: Context, pipelines: Pipelines, multi_draw: bool, workers: Workers, settings: Settings
) -> Commands:
    """Return what makes the calls of frames: where there are workers, they prepare them."""
    if workers.count == 0:
        return Commands(context, pipelines, multi_draw)
    return ParallelCommands(context, pipelines, multi_draw, workers, settings.draws_per_secondary)


class CallList:
    """Stands in for a context: calls of its `fn` are written down, to be made later, on the context's thread."""

    def __init__(self) -> None:
        self.fn = self
        self.calls: list[tuple[str | Callable[..., None], tuple[Any, ...]]] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        if not name.startswith("gl"):
            raise AttributeError(name)
        # By its name: the address of a function may be asked for on the context's thread alone.
        return lambda *arguments: self.calls.append((name, arguments))

    def make(self, fn: gl.Functions) -> None:
        """Make all calls, in their order."""
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
        """Write down that a pipeline is to be bound; the context's thread knows what is bound already."""
        self.list.calls.append((self._pipelines.bind, (pipeline, cull, front)))
        self.work["pipeline_binds"] += 1


class ParallelCommands(Commands):
    """Makes calls as `Commands` does, but has groups of draws turned into calls by several threads."""

    def __init__(
        self, context: Context, pipelines: Pipelines, multi_draw: bool, workers: Workers, least_calls: int
    ) -> None:
        super().__init__(context, pipelines, multi_draw)
        self._workers, self._least = workers, least_calls

    def begin(self, slot: FrameSlot) -> None:
        """Work for `slot` from here on, with all counters at zero."""
        super().begin(slot)
        self.work |= ALONE

    def draw_groups(self, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Draw all of `groups` in order; with enough calls, lists of them are made by all threads before.

        Raises TaskError, when all threads have stopped, if a list could not be made.
        """
        found = Groups(groups, self._multi_draw)
        parts = part_count(found.end, self._least)
        if not parts:
            super().draw_groups(groups, scene)
            return
        listed: dict[int, ListedCommands] = {}

        def write(first: int, last: int, thread: int) -> None:
            commands = ListedCommands(self._pipelines, self._multi_draw, self.slot)
            commands.draw_groups(found.part(first, last), scene)
            listed[first] = commands

        self._workers.share("list draws", write, found.end, parts)
        for first, _ in split(found.end, parts):
            listed[first].list.make(self._context.fn)
            for name, number in listed[first].work.items():
                self.work[name] += number
        self.work["recorded_parts"] += parts
        self.work["recording_threads"] = 1 + self._workers.count
