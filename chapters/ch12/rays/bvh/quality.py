"""Which hierarchies are due for a rebuild, by reports of what their boxes cost after refits. No device.

A kernel measures the cost of a hierarchy behind each refit (quality.comp). The CPU reads it when the slot of that frame
comes round again, two frames later, and so it never waits. Where the cost has risen too much above that at the build,
the hierarchy is built anew in the frame that has read it, within a budget.
"""

from __future__ import annotations

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
        self.sizes = np.array(sizes, np.int64)
        self._built_cost = np.array(costs, np.float64)
        self._most, self._budget = max(most, 1.0), budget  # less would build what has not moved
        self._either_way = either_way
        count = len(self.sizes)
        self.watched: NDArray[np.bool_] = (self.sizes > np.array(least)) & (self.sizes <= budget)
        self._last = self.watched & (np.arange(count) == count - 1)
        self.ratios: NDArray[np.float64] = np.ones(count)
        """Of each, by the last report: its cost in costs at its build."""
        self.builds: NDArray[np.int64] = np.zeros(count, np.int64)
        """How often each was built anew."""
        self.worst_percent = 100
        """The largest of `ratios` that the last report had, in percent."""
        self._asked: list[tuple[NDArray[np.bool_], NDArray[np.int64]] | None] = [None] * SLOTS
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
        known = measured & (builds == self.builds)
        first = known & np.isnan(self._built_cost)  # by the frame that built it
        self._built_cost[first] = costs[first]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(costs > 0, costs / self._built_cost, 1.0)
            if self._either_way:
                ratios = np.maximum(ratios, 1.0 / ratios)
        self.ratios[known] = ratios[known]
        worst = float(self.ratios.max())
        self._late = worst > self._most
        self.worst_percent = round(min(100.0 * worst, 1e9))

    def due(self) -> tuple[int, ...]:
        """Return what this frame builds anew, and count it as built: the worst first, as long as the budget lasts."""
        if not self._late:
            return ()
        late = np.flatnonzero(self.watched & (self.ratios > self._most))
        late = late[np.argsort(-self.ratios[late], kind="stable")]
        late = late[np.cumsum(self.sizes[late]) <= self._budget]
        self.builds[late] += 1
        self._built_cost[late], self.ratios[late] = np.nan, 1.0
        self._late = bool((self.ratios > self._most).any())
        return tuple(late.tolist())

    def ask(self, slot: int, everything: bool) -> None:
        """Note that a frame measures what is watched: everything, or the last alone."""
        self._asked[slot] = (self.watched if everything else self._last, self.builds.copy())
