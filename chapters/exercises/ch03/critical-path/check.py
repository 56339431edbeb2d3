"""Graphs of tasks whose longest chain is found here by trying all chains, against what the copy says."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from tools.exercises.checking import Given

FRAME = {
    "read": (4.0, ()),
    "decode": (6.0, ("read",)),
    "cull": (1.0, ()),
    "record": (5.0, ("cull",)),
    "upload": (2.0, ("decode",)),
    "submit": (1.0, ("record", "upload")),
}


def check(given: Given) -> None:
    """A frame, no task, tasks without a time, equal chains, and graphs at random."""
    found: Any = getattr(given.module("tasks.critical_path"), "critical_path", None)
    given.need(callable(found), "tasks/critical_path.py has no function critical_path yet.")
    graph_class = given.module("tasks.graph").TaskGraph

    def answer(steps: Mapping[str, Sequence[str]], times: Mapping[str, float]) -> tuple[float, list[str]]:
        graph = graph_class("checked")
        for name, after in steps.items():
            graph.add(name, lambda: None, after=after)
        total, path = found(graph, times)
        return total, list(path)

    steps = {name: list(after) for name, (_, after) in FRAME.items()}
    times = {name: time for name, (time, _) in FRAME.items()}
    total, path = answer(steps, times)
    given.need(
        (total, path) == (13.0, ["read", "decode", "upload", "submit"]),
        f"read, decode, upload, submit take 13 one after the other; the answer is {total} for {', '.join(path)}.",
    )
    given.need(answer({}, {}) == (0.0, []), "A graph without tasks has a path.")
    total, path = answer({"a": (), "b": ("a",)}, {"a": 2.0})
    given.need(
        total == 2.0, f"A task without a time takes none, so a path of 2 and nothing is 2, not {total}."
    )
    total, path = answer(
        {"late": ("one", "other"), "other": (), "one": ()}, {"late": 1.0, "one": 3.0, "other": 3.0}
    )
    given.need(
        path == ["one", "late"], "Of equal chains the one counts whose task is named first in `after`."
    )
    rng = random.Random(3)
    for _ in range(40):
        names = [f"t{number}" for number in range(8)]
        steps = {
            name: [before for before in names[:number] if rng.random() < 0.4]
            for number, name in enumerate(names)
        }
        times = {name: float(rng.randint(0, 9)) for name in names}
        shuffled = dict(rng.sample(sorted(steps.items()), len(steps)))
        total, path = answer(shuffled, times)
        longest = max(_longest(name, steps, times) for name in names)
        given.need(
            total == longest, f"A graph whose longest chain takes {longest:g} is said to take {total:g}."
        )
        chained = all(before in steps[after] for before, after in pairwise(path))
        given.need(chained, f"In the path {', '.join(path)} a task does not come after the one before it.")
        given.need(
            sum(times[name] for name in path) == longest, "The tasks of the path take less than it says."
        )


def _longest(name: str, steps: Mapping[str, Sequence[str]], times: Mapping[str, float]) -> float:
    return times[name] + max((_longest(before, steps, times) for before in steps[name]), default=0.0)
