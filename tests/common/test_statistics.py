"""Statistics against closed forms, simulation and scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.numerics.statistics import (
    Estimate,
    chi_square,
    chi_square_tail,
    estimate,
    level_of_each,
    mad,
    mean_interval,
    noise,
)


def test_mad_and_noise():
    assert mad([1, 1, 2, 2, 4, 6, 9]) == 1.0
    samples = np.random.default_rng(1).normal(10.0, 3.0, 100_000)
    assert noise(samples) == pytest.approx(3.0, rel=0.01)
    samples[::10] = 1e6  # interruptions
    assert noise(samples) == pytest.approx(3.0, rel=0.2)


def test_interval_of_the_median_by_hand():
    # Ten samples: P(fewer than 2 below the median) = 11/1024, fewer than 3: 56/1024 > 2.5 %.
    assert estimate(range(10)) == Estimate(4.5, 1.0, 8.0, pytest.approx(1.4826 * 2.5, rel=1e-4), 10)
    # Six samples: both tails are 2/64 = 3.1 %; five: 6.3 %, too much even for all of them.
    assert (estimate([3, 1, 2, 6, 5, 4]).low, estimate([3, 1, 2, 6, 5, 4]).high) == (1.0, 6.0)
    assert estimate([7.0]) == Estimate(7.0, 7.0, 7.0, 0.0, 1)


@pytest.mark.parametrize("count", [10, 31, 100])
def test_the_interval_holds_the_median_as_often_as_it_says(count):
    rng = np.random.default_rng(count)
    runs = np.exp(rng.normal(size=(2000, count)))  # skewed, median 1
    hits = [found.low <= 1.0 <= found.high for found in map(estimate, runs)]
    assert 0.94 <= np.mean(hits) <= 0.99


def test_thousands_of_samples():
    samples = np.random.default_rng(3).random(5001)
    found = estimate(samples)
    # The median of uniform samples has the standard deviation 1 / (2 sqrt(n)).
    assert found.high - found.low == pytest.approx(2 * 1.96 / (2 * math.sqrt(5001)), rel=0.2)


def test_the_rank_does_not_jump_where_the_formula_changes():
    widths = [estimate(range(n)).high - estimate(range(n)).low for n in range(980, 1020)]
    assert max(widths) - min(widths) <= 4


def test_overlap():
    a, b, c = (Estimate(m, m - 1, m + 1, 0.1, 9) for m in (1.0, 2.5, 4.0))
    assert a.overlaps(b) and b.overlaps(a) and b.overlaps(c) and not a.overlaps(c) and not c.overlaps(a)


def test_interval_of_the_mean():
    mean, half = mean_interval([1, 2, 3, 4, 5])
    assert mean == 3.0 and half == pytest.approx(1.959964 * math.sqrt(2.5 / 5), rel=1e-6)


@pytest.mark.parametrize("x", [0.0, 0.1, 1.0, 3.7, 30.0, 500.0])
def test_tail_in_closed_form(x):
    # Two degrees: exp(-x/2); one: erfc(sqrt(x/2)); six: a Poisson sum.
    assert chi_square_tail(x, 2) == pytest.approx(math.exp(-x / 2), rel=1e-12)
    assert chi_square_tail(x, 1) == pytest.approx(math.erfc(math.sqrt(x / 2)), rel=1e-10)
    h = x / 2
    assert chi_square_tail(x, 6) == pytest.approx(math.exp(-h) * (1 + h + h * h / 2), rel=1e-12)


@pytest.mark.needs("scipy")
def test_tail_against_scipy():
    from scipy import special

    for freedom in (1, 3, 10, 99, 1000, 100_000):
        for factor in (0.0, 0.5, 0.9, 1.0, 1.01, 1.2, 3.0):
            truth = special.chdtrc(freedom, freedom * factor)
            assert chi_square_tail(freedom * factor, freedom) == pytest.approx(truth, rel=1e-8, abs=1e-12)
    assert chi_square_tail(math.inf, 4) == 0.0


def test_chi_square_by_hand():
    found = chi_square([22, 18, 28, 32], [25, 25, 25, 25])
    assert found.statistic == pytest.approx((9 + 49 + 9 + 49) / 25) and found.freedom == 3
    assert found.p == pytest.approx(0.2, abs=0.01)


def test_small_cells_are_put_together():
    # 1 + 2 is below five, so the next one joins: three cells are left.
    found = chi_square([0, 4, 9, 20, 17], [1, 2, 7, 20, 20])
    assert found.freedom == 2 and found.statistic == pytest.approx((13 - 10) ** 2 / 10 + 9 / 20)
    assert chi_square([0, 50, 50], [0, 50, 50]).p == 1.0


def test_a_sample_where_none_can_be():
    assert chi_square([1, 49, 50], [0, 50, 50]).p == 0.0


def test_p_is_uniform_for_right_samplers_and_nothing_for_wrong_ones():
    rng = np.random.default_rng(8)
    density = np.linspace(0.2, 1.8, 50) / 50
    right = [chi_square(rng.multinomial(10_000, density), 10_000 * density).p for _ in range(400)]
    for quarter in (0.25, 0.5, 0.75):
        assert np.mean(np.array(right) < quarter) == pytest.approx(quarter, abs=0.08)
    wrong = chi_square(rng.multinomial(10_000, np.full(50, 1 / 50)), 10_000 * density)
    assert wrong.p < 1e-12


def test_level_of_each():
    assert level_of_each(0.01, 1) == pytest.approx(0.01, rel=1e-12)
    each = level_of_each(0.01, 500)
    assert 1 - (1 - each) ** 500 == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "fault"),
    [
        (lambda: estimate([]), "no samples"),
        (lambda: estimate([1.0, math.nan]), "not finite"),
        (lambda: estimate([1.0], 1.0), "between 0 and 1"),
        (lambda: mean_interval([1.0]), "give two"),
        (lambda: chi_square([1, 2], [1, 1]), "predicts 2"),
        (lambda: chi_square([1, 2], [3]), "one shape"),
        (lambda: chi_square([-1, 2], [1, 0]), "not below 0"),
        (lambda: chi_square([3, 3], [3, 3]), "fewer than two cells"),
        (lambda: chi_square_tail(-1.0, 3), "no tail"),
    ],
)
def test_what_is_refused(call, fault):
    with pytest.raises(ValueError, match=fault):
        call()
