"""The controller of the study dynamic-resolution, with loads whose answer follows from a formula."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch11.studies.dynamic_resolution import loads
from chapters.ch11.studies.dynamic_resolution.controller import (
    COUNT,
    FOLLOWS,
    LATE,
    ROOM,
    SCALES,
    WINDOW,
    Controller,
)
from common.errors import SettingError, UserError

TARGET = 10.0
IN_FLIGHT = 2
"""Frames that were begun before a time is known."""


def run(controller, plant, count, first=0):
    """Return the number of each frame's scale; `plant(n, scale)` is frame n's time, known IN_FLIGHT frames later."""
    numbers = []
    for n in range(first, first + count):
        numbers.append(controller.number)
        if len(numbers) > IN_FLIGHT:
            at = n - IN_FLIGHT
            controller.next(plant(at, SCALES[numbers[-1 - IN_FLIGHT]]))
    return numbers


def quadratic(whole, fixed=0.0):
    """Return a plant with a constant load."""
    return lambda n, scale: TARGET * (fixed + whole * scale**2)


def changes(numbers):
    return int(np.count_nonzero(np.diff(numbers)))


def test_scales_go_from_half_to_all_in_a_constant_ratio():
    assert (SCALES[0], SCALES[-1], len(SCALES)) == (0.5, 1.0, 8)
    assert np.allclose(np.diff(np.log2(SCALES)), 1 / 7, rtol=0, atol=1e-15)


@pytest.mark.parametrize("start", range(COUNT))
@pytest.mark.parametrize("whole", [0.05, 0.3, 0.79, 0.81, 0.99, 1.01, 1.3, 2.0, 3.5, 4.2, 20.0])
def test_a_constant_load_is_reached_and_stays(whole, start):
    """Within one decision: the model is exact. The scale holds the target, if any does; a larger one has no room."""
    numbers = run(Controller(TARGET, start), quadratic(whole), 3000)
    last = numbers[-1]
    assert set(numbers[FOLLOWS + IN_FLIGHT :]) == {last} and changes(numbers) <= 1
    assert whole * SCALES[last] ** 2 <= 1.0 or last == 0
    if last < COUNT - 1:
        assert whole * SCALES[last + 1] ** 2 > ROOM


@pytest.mark.parametrize("fixed", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("whole", [0.2, 0.6, 1.0, 1.7, 2.4])
@pytest.mark.parametrize("start", [0, 4, 7])
def test_a_load_with_a_fixed_part_is_reached_in_a_few_steps_and_stays(whole, fixed, start):
    numbers = run(Controller(TARGET, start), quadratic(whole, fixed), 3000)
    last = numbers[-1]
    assert set(numbers[7 * (FOLLOWS + IN_FLIGHT) :]) == {last}
    assert np.all(np.diff(np.sign(np.diff(numbers))[np.diff(numbers) != 0]) == 0), "in one direction"
    assert fixed + whole * SCALES[last] ** 2 <= 1.0 or last == 0


@pytest.mark.parametrize("at", [3, 40, 100, 101, 117, 126])
@pytest.mark.parametrize(("before", "after"), [(0.5, 2.0), (2.0, 0.5), (1.0, 3.0), (3.5, 0.9)])
def test_a_step_of_the_load_is_followed(before, after, at):
    def plant(n, scale):
        return TARGET * (before if n < at else after) * scale**2

    numbers = run(Controller(TARGET), plant, 600)
    settled = run(Controller(TARGET, numbers[at]), quadratic(after), 600)[-1]
    within = (
        WINDOW // 2 + 1 if at >= 100 else 2 * FOLLOWS
    )  # where the load before had been reached, by the median
    assert {*numbers[at + within + IN_FLIGHT :]} == {numbers[-1]}
    assert after * SCALES[numbers[-1]] ** 2 <= 1.0
    assert numbers[-1] == settled or abs(numbers[-1] - settled) == 1, "within the band"


@pytest.mark.parametrize("kind", ["even", "normal"])
@pytest.mark.parametrize("whole", [0.5, 0.8, 0.95, 1.0, 1.05, 1.5, 2.2, 3.0, 3.9])
def test_noise_of_a_tenth_does_not_make_it_oscillate(whole, kind):
    random = np.random.default_rng(int(100 * whole))
    noise = random.uniform(-0.1, 0.1, 20_000) if kind == "even" else random.normal(0, 0.1, 20_000).clip(-0.5)
    numbers = run(Controller(TARGET), lambda n, scale: TARGET * whole * scale**2 * (1 + noise[n]), 20_000)
    assert changes(numbers) <= 2 and changes(numbers[500:]) <= 1
    assert whole * SCALES[numbers[-1]] ** 2 <= 1.03


def test_a_rule_without_a_band_oscillates_under_the_same_noise():
    """So the noise is enough to tell: the scale that the last frame alone asks for changes all the time."""
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, 2000)
    number, numbers = COUNT - 1, []
    for n in range(2000):
        ms = 1.3 * SCALES[number] ** 2 * (1 + noise[n])
        fits = [k for k in range(COUNT) if ms * (SCALES[k] / SCALES[number]) ** 2 <= 1.0]
        number = max(fits, default=0)
        numbers.append(number)
    assert changes(numbers) > 500


def test_times_that_were_not_measured_are_ignored():
    plain, mixed = Controller(TARGET), Controller(TARGET)
    for n in range(200):
        ms = 25.0 if n > 50 else 5.0
        for bad in (math.nan, 0.0, -3.0, math.inf):
            mixed.next(bad)
        assert mixed.next(ms) == plain.next(ms * 1.0)
    assert plain.number < COUNT - 1


def test_single_slow_frames_do_not_matter():
    controller = Controller(TARGET)
    numbers = [controller.next(500.0 if n % 10 == 0 else 9.0) for n in range(400)]
    assert {*numbers} == {COUNT - 1}


def test_after_a_change_late_frames_are_left_out_and_a_window_is_awaited():
    controller = Controller(TARGET)
    for _ in range(WINDOW):
        controller.next(15.0)
    assert (
        controller.number == 4
    )  # scale 5 costs 15 ms * 2^(-4/7) = 10.1 ms, scale 4 15 ms * 2^(-6/7) = 8.3 ms
    for _ in range(LATE):
        controller.next(1e3)
    for _ in range(WINDOW - 1):
        assert controller.next(20.0) == 4
    assert controller.next(20.0) == 0  # 20 ms * 2^(-8/7) = 9.1 ms is 4 scales lower


@pytest.mark.parametrize("target", [0.0, -16.7, math.nan, math.inf, 1e5])
def test_a_target_that_is_no_time_is_refused_in_one_sentence(target):
    with pytest.raises(SettingError, match="target_ms") as found:
        Controller(target)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("number", [-1, 8, 2.0, True])
def test_a_number_that_no_scale_has_is_refused(number):
    with pytest.raises(UserError, match="0 to 7"):
        Controller(TARGET, number)


# --- loads ---


def test_loads_follow_their_formula():
    """0.1 + 0.6 and 0.1 + 1.6 targets in turns of 60 frames; a wave between both."""
    for number, whole in ((0, 0.7), (59, 0.7), (60, 1.7), (119, 1.7), (120, 0.7)):
        assert loads.frame_ms("step", number, 1.0, TARGET) == pytest.approx(TARGET * whole)
    for number, whole in ((0, 0.7), (30, 1.2), (60, 1.7), (90, 1.2), (120, 0.7)):
        assert loads.frame_ms("wave", number, 1.0, TARGET) == pytest.approx(TARGET * whole)
    assert loads.frame_ms("step", 0, 0.5, TARGET) == pytest.approx(TARGET * (0.1 + 0.6 / 4))


@pytest.mark.parametrize("load", [*loads.LOADS])
def test_most_of_the_time_above_the_target_is_gone_under_each_load(load):
    def plant(n, scale):
        return loads.frame_ms(load, n, scale, TARGET)

    numbers = run(Controller(TARGET), plant, 600)
    excess = sum(max(plant(n, SCALES[number]) - TARGET, 0.0) for n, number in enumerate(numbers))
    alone = sum(max(plant(n, 1.0) - TARGET, 0.0) for n in range(600))
    assert 0 < excess < {"step": 0.3, "wave": 0.45}[load] * alone
    assert len({*numbers}) > 1
