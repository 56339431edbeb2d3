"""The frame clock and fixed steps, on timers that are written down."""

from __future__ import annotations

import random
from fractions import Fraction
from itertools import pairwise

import pytest

from common.view.clock import Duration, FixedStep, FrameClock


def clock_of(*times: int) -> FrameClock:
    stream = iter(times)
    return FrameClock(lambda: next(stream))


@pytest.mark.feature("core/frame-clock")
def test_time_is_monotone_with_positive_delta():
    clock = clock_of(1000, 1500, 1500, 900, 1600)  # stands still, goes back
    ticks = [clock.tick() for _ in range(4)]
    assert [tick.delta.ns for tick in ticks] == [500, 1, 1, 100]
    assert [tick.time.ns for tick in ticks] == [500, 501, 502, 602]
    assert [tick.frame for tick in ticks] == [0, 1, 2, 3]


@pytest.mark.feature("core/frame-clock")
def test_the_machines_timer():
    clock = FrameClock()
    times = [clock.tick().time.ns for _ in range(10_000)]
    assert all(a < b for a, b in pairwise(times))


@pytest.mark.feature("core/frame-clock")
@pytest.mark.parametrize("ns", [0, 1, 999, 1_000_000, 1_234_567_891, 2**60 + 1])
def test_conversions_are_the_nearest_floats(ns):
    duration = Duration(ns)
    assert duration.s == float(Fraction(ns, 10**9))
    assert duration.ms == float(Fraction(ns, 10**6))
    assert duration.us == float(Fraction(ns, 10**3))


@pytest.mark.feature("core/frame-clock")
def test_steps_follow_time_and_not_frames():
    rng = random.Random(2)
    for longest_ms in (1, 9, 40, 99):  # many frames to a step, and many steps to a frame
        fixed, elapsed, steps = FixedStep(), 0, 0
        for _ in range(2_000):
            delta = rng.randrange(longest_ms * 1_000_000)
            elapsed += delta
            steps += fixed.advance(Duration(delta))
            assert steps == elapsed // 10_000_000
            assert fixed.fraction == (elapsed % 10_000_000) / 10_000_000


@pytest.mark.feature("core/frame-clock")
def test_a_pause_makes_ten_steps_at_most():
    fixed = FixedStep()
    assert fixed.advance(Duration(100_000_000)) == 10
    assert fixed.advance(Duration(5_004_000_000)) == 10
    assert (
        fixed.advance(Duration(6_000_000)) == 1
    )  # the rest of the pause is forgotten, 4 ms of a step are not
    assert FixedStep(max_steps=3).advance(Duration(10**12)) == 3


@pytest.mark.feature("core/frame-clock")
def test_refused():
    for step, most in ((0, 10), (-1, 10), (1, 0)):
        with pytest.raises(ValueError, match="positive"):
            FixedStep(step, most)
    assert FixedStep().advance(Duration(-5)) == 0
