"""Times that tests compare, measured on machines that do other things as well, and now and then are slow for seconds.

Noise only adds to a time: of many measurements the least is nearest to the truth. So what a test compares is measured
in turns, round after round, until what it claims holds of the least times, or the time for it is spent. What is really
slower stays slower in every round. Two rules for who uses this:

- What is compared takes about as long on each side (`calls`): a short piece finds a quiet moment where a long one
  finds none.
- A time of one thread's work is its CPU time, to which nothing else on the machine adds but caches, memory and clock
  rates; wall time is for what waits.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

Key = TypeVar("Key", bound=Hashable)

PATIENCE_S = 30.0
"""How long a test waits for what surely happens, as long as nothing hangs: no bound on speed."""


def timed(
    work: Callable[[], object],
    calls: int = 1,
    clock: Callable[[], float] = time.thread_time,
    before: Callable[[], object] | None = None,
) -> Callable[[], float]:
    """Return a function that measures `work`: it returns the seconds of one call, by the mean of as many in a row.

    `before` is called in front of them, and its time is not counted.
    """

    def measured() -> float:
        if before is not None:
            before()
        began = clock()
        for _ in range(calls):
            work()
        return (clock() - began) / calls

    return measured


def least_times(
    measures: Mapping[Key, Callable[[], float]],
    holds: Callable[[dict[Key, float]], bool],
    fewest: int = 3,
    seconds: float = 3.0,
) -> dict[Key, float]:
    """Return the least that each of `measures` returned in some rounds, in which each has its turn.

    There are at least `fewest` rounds, and then more until `holds(least)`, or for so many `seconds`. Who calls this
    asserts what should hold. Garbage is collected before, not meanwhile: what other tests left is none of the work's.
    """
    least: dict[Key, float] = {}
    rounds = 0
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    end = time.monotonic() + seconds
    try:
        while rounds < fewest or (not holds(least) and time.monotonic() < end):
            for key, measure in measures.items():
                took = measure()
                least[key] = min(took, least.get(key, took))
            rounds += 1
    finally:
        if was_enabled:
            gc.enable()
    return least


def least_time(measure: Callable[[], float], bound: float, fewest: int = 3, seconds: float = 3.0) -> float:
    """Return the least of one measure as `least_times` finds it, which goes on until it is below a bound."""
    return least_times({"": measure}, lambda least: least[""] < bound, fewest, seconds)[""]


def once_more(took: Sequence[float], bound: float, most: int = 4) -> bool:
    """Whether a test that cannot hand over what it measures, as a script of events, measures it another time."""
    return not took or (min(took) >= bound and len(took) < most)


def until(done: Callable[[], object], seconds: float = PATIENCE_S) -> None:
    """Wait until `done()` is true, and no longer; fail if it does not become so."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, f"it did not happen within {seconds:g} s"
        time.sleep(0.001)
