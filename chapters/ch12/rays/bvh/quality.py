"""Which hierarchies are due for a rebuild, by reports of what their boxes cost after refits. No device.

A kernel measures the cost of a hierarchy behind each refit (quality.comp). The CPU reads it when the slot of that frame
comes round again, two frames later, and so it never waits. Where the cost has risen too much above that at the build,
the hierarchy is built anew in the frame that has read it, within a budget.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...frames.frame import SLOTS


class Watch:
    """The cost of hierarchies of these sizes (triangles or instances), against `costs` at their build.

    `most` is the ratio from which on they are due, `budget` how many triangles and instances a frame builds. A
    hierarchy that is larger than that is not watched, nor one of at most `least`, which has one form alone.
    `either_way` says that a cost that has fallen as much is a reason, too.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        costs: Sequence[float],
        least: Sequence[int],
        most: float,
        budget: int,
        either_way: bool = False,
    ) -> None:
        self._sizes, self._built_cost = list(sizes), list(map(float, costs))
        self._most, self._budget = max(most, 1.0), budget  # less would build what has not moved
        self._either_way = either_way
        count = len(self._sizes)
        self.watched: tuple[int, ...] = tuple(
            number for number, size in enumerate(self._sizes) if least[number] < size <= budget
        )
        """The numbers of the hierarchies that are watched, in order."""
        self._last = tuple(number for number in self.watched if number == count - 1)
        self.ratios = [1.0] * count
        """Of each, by the last report: its cost in costs at its build."""
        self.builds: tuple[int, ...] = (0,) * count
        """How often each was built anew."""
        self.worst_percent = 100
        """The largest of `ratios` that the last report had, in percent."""
        self._asked: list[tuple[tuple[int, ...], tuple[int, ...]] | None] = [None] * SLOTS
        self._late = False

    def asks(self, slot: int) -> bool:
        """Whether the last frame of a slot has measured."""
        return self._asked[slot] is not None

    def take(self, slot: int, costs: NDArray[np.floating]) -> None:
        """Take the report of the last frame of a slot. What was built anew since is left out."""
        asked = self._asked[slot]
        assert asked is not None, "`asks` says so"
        self._asked[slot] = None
        measured, builds = asked
        for number in measured:
            if builds[number] != self.builds[number]:
                continue
            cost = float(costs[number])
            if math.isnan(self._built_cost[number]):  # by the frame that built it
                self._built_cost[number] = cost
            self.ratios[number] = self._ratio(cost, self._built_cost[number])
        worst = max(self.ratios)
        self._late = worst > self._most
        self.worst_percent = round(min(100.0 * worst, 1e9))

    def _ratio(self, cost: float, built: float) -> float:
        if not 0 < cost < math.inf:  # nothing is there, or nothing finite
            return 1.0
        ratio = cost / built if built > 0 else math.inf
        fallen = self._either_way and ratio < 1
        return built / cost if fallen else ratio

    def due(self) -> tuple[int, ...]:
        """Return what this frame builds anew, and count it as built: the worst first, as long as the budget lasts."""
        if not self._late:
            return ()
        late = [number for number in self.watched if self.ratios[number] > self._most]
        late.sort(key=lambda number: -self.ratios[number])
        sums = itertools.accumulate(self._sizes[number] for number in late)
        late = [number for number, size in zip(late, sums, strict=True) if size <= self._budget]
        builds = list(self.builds)
        for number in late:
            builds[number] += 1
            self._built_cost[number], self.ratios[number] = math.nan, 1.0
        self.builds = tuple(builds)
        self._late = max(self.ratios) > self._most
        return tuple(late)

    def ask(self, slot: int, everything: bool) -> None:
        """Note that a frame measures what is watched: everything, or the last alone."""
        self._asked[slot] = (self.watched if everything else self._last, self.builds)
