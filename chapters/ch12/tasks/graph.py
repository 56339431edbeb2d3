"""A graph of tasks by name: made once, checked for cycles, run in every frame, and drawn by Graphviz.

    graph = TaskGraph("frame")
    graph.add("cull", cull)
    graph.add_range("record", record, count=len(draws), after=["cull"])
    graph.add("submit", submit, after=["record"])

The graph only says what there is to do and what comes after what. `tasks.Scheduler` runs it, as often as one likes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

from common.names import suggest

if TYPE_CHECKING:
    from .scheduler import Scheduler
    from .state import Task

Work = Callable[[], Any]
"""What a task does; what it returns is the task's result."""

RangeWork = Callable[[int, int, int], object]
"""What each part of a range does: (first, last, thread) are the indices [first, last) and the thread's own index."""


@dataclass(frozen=True)
class Step:
    """One task of a graph: its name, what it comes after, how it is spawned, and a note for drawings."""

    name: str
    after: tuple[str, ...]
    spawn: Callable[[Scheduler, Sequence[Task[Any]]], Task[Any]]
    note: str = ""


class TaskGraph:
    """Steps by name. What a step comes after may be added later than the step."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.steps: dict[str, Step] = {}

    def add(
        self, name: str, work: Work, *, after: Iterable[str] = (), pin: str | None = None, priority: int = 0
    ) -> None:
        """Add a task; `pin` and `priority` are those of `Scheduler.spawn`. ValueError for a name that is taken."""

        def spawn(tasks: Scheduler, before: Sequence[Task[Any]]) -> Task[Any]:
            return tasks.spawn(name, work, after=before, pin=pin, priority=priority)

        self._add(Step(name, tuple(after), spawn, f"on {pin}" if pin else ""))

    def add_range(
        self,
        name: str,
        work: RangeWork,
        count: int,
        *,
        parts: int | None = None,
        after: Iterable[str] = (),
        priority: int = 0,
    ) -> None:
        """Add a task over the indices [0, count), see `Scheduler.spawn_range`. ValueError for a name that is taken."""

        def spawn(tasks: Scheduler, before: Sequence[Task[Any]]) -> Task[Any]:
            return tasks.spawn_range(name, work, count, parts=parts, after=before, priority=priority)

        self._add(Step(name, tuple(after), spawn, f"0 to {count}"))

    def _add(self, step: Step) -> None:
        if step.name in self.steps:
            raise ValueError(f"the graph {self.name!r} has a task {step.name!r} already")
        self.steps[step.name] = step

    def edges(self) -> list[tuple[str, str]]:
        """Return every (before, after), without repetition.

        Raises:
            ValueError: a task comes after one that is not in the graph.
        """
        for step in self.steps.values():
            for before in step.after:
                if before not in self.steps:
                    raise ValueError(
                        f"in the graph {self.name!r}, {step.name!r} comes after {before!r}, which is not there"
                        + suggest(before, self.steps)
                    )
        return [(before, step.name) for step in self.steps.values() for before in dict.fromkeys(step.after)]

    def ordered(self) -> list[Step]:
        """Return the steps, each behind all that it comes after.

        Raises:
            graphlib.CycleError: there is no such order; the text shows the path of names that leads back to its
                beginning, and `args[1]` is that path.
            ValueError: a task comes after one that is not in the graph.
        """
        before: dict[str, list[str]] = {name: [] for name in self.steps}
        for first, second in self.edges():
            before[second].append(first)
        try:
            return [self.steps[name] for name in TopologicalSorter(before).static_order()]
        except CycleError as error:
            path = error.args[1]
            text = (
                f"the graph {self.name!r} has no beginning: each comes before the next in {' -> '.join(path)}"
            )
            raise CycleError(text, path) from None

    def dot(self) -> str:
        """Return the graph in Graphviz' language: `dot -Tsvg` draws it. A cycle is no error here; it can be seen."""
        lines = [f"digraph {_quoted(self.name)} {{", "  rankdir=LR;", "  node [shape=box];"]
        for step in self.steps.values():
            label = f"{step.name}\n{step.note}" if step.note else step.name
            lines.append(f"  {_quoted(step.name)} [label={_quoted(label)}];")
        lines += [f"  {_quoted(before)} -> {_quoted(after)};" for before, after in self.edges()]
        return "\n".join([*lines, "}"]) + "\n"


def _quoted(text: str) -> str:
    r"""Return a quoted string of the language, in which a line ends with \n."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
