"""Numbers of blue noise from frame to frame, and their triangular sum: closed forms, and GLSL to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics import blue_noise
from common.numerics.blue_noise import FRAMES, SIZE, animated, ranks, triangular

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
"""The fractional part of the golden ratio."""

animation = pytest.mark.feature("noise/temporal-animation")


def fibonacci(count):
    numbers = [1, 1]
    while len(numbers) < count:
        numbers.append(numbers[-1] + numbers[-2])
    return numbers


@animation
def test_a_number_is_the_fractional_part_of_rank_and_frame():
    """The constant is golden to half of 2^-32, which 255 frames multiply; cutting to 24 bits takes 2^-24 at most."""
    rank, frame = np.meshgrid(np.arange(0, SIZE**2, 37), np.arange(FRAMES))
    exact = ((rank + 0.5) / SIZE**2 + frame * GOLDEN) % 1.0
    off = animated(rank, frame) - exact
    off -= np.round(off)  # 0 and 1 are one place
    assert off.min() >= -(2.0**-24) - 255 * 2.0**-33 and off.max() <= 255 * 2.0**-33


@animation
@pytest.mark.parametrize("rank", [0, 1, 5000, SIZE**2 - 1])
def test_256_frames_of_a_texel_cover_the_interval(rank):
    """By the three-distance theorem there are three gaps, |F(k) golden - F(k-1)| for Fibonacci numbers around 256."""
    numbers = np.sort(animated(rank, np.arange(FRAMES)).astype(np.float64))
    assert numbers[0] >= 0.0 and numbers[-1] < 1.0
    gaps = np.diff(np.append(numbers, numbers[0] + 1.0))
    fib = fibonacci(20)
    small, middle = (abs(fib[k] * GOLDEN - fib[k - 1]) for k in (12, 11))  # 233 and 144 frames apart
    expected = np.array([small, middle, small + middle])
    assert np.round(expected, 4).tolist() == [0.0019, 0.0031, 0.005]
    nearest = np.abs(gaps[:, None] - expected).min(axis=1)
    assert nearest.max() < 2.0**-23 + 2 * 255 * 2.0**-33
    assert 0.0050 < gaps.max() <= 0.0051
    # A random 256 would leave a gap of ln(256) / 256 = 0.0217 on average.


@animation
@pytest.mark.parametrize("count", [8, 32, 100, 256])
def test_the_first_frames_are_spread_evenly_whatever_their_number(count):
    """No gap is more than 1 / golden^2 = 2.62 times the mean gap, times what the last Fibonacci number left."""
    numbers = np.sort(animated(77, np.arange(count)).astype(np.float64))
    gaps = np.diff(np.append(numbers, numbers[0] + 1.0))
    assert gaps.max() * count < (1 + GOLDEN) ** 2
    assert gaps.min() * count > GOLDEN**2


@animation
def test_frames_repeat_after_256_and_a_large_count_is_no_less_exact():
    rank = np.arange(0, SIZE**2, 11)
    for frame in (0, 1, 255):
        assert np.array_equal(animated(rank, frame), animated(rank, frame + 256))
        assert np.array_equal(animated(rank, frame), animated(rank, 2**32 - 256 + frame))
    assert not np.array_equal(animated(rank, 0), animated(rank, 128))


@animation
@pytest.mark.parametrize("frame", [0, 1, 100])
def test_the_sum_of_two_is_triangular(frame):
    """Over the table: mean 0, variance 1/6 and density 1 - |x|, within what two independent channels deviate by.

    The numbers of a channel are the fixed set of all ranks. Only the pairing is random: the sum's variance is
    (1/12 + 1/12 + 2 covariance), and the covariance of n pairs deviates by (1/12) / sqrt(n).
    """
    first, second = animated(ranks()[..., 0], frame), animated(ranks()[..., 1], frame)
    total = triangular(first, second).astype(np.float64)
    assert total.min() >= -1.0 and total.max() < 1.0
    # A number in the middle of its 2^14th: cut to 24 bits it lies 2^-25 lower on average, and 2^-24 at most.
    assert abs(total.mean()) <= 2 * SIZE**-2.0
    assert abs(total.var() - 1 / 6) < 5 * 2 / 12 / SIZE
    share, edges = np.histogram(total, bins=20, range=(-1, 1))
    integral = edges - np.sign(edges) * edges**2 / 2
    expected = np.diff(integral)
    assert (np.abs(share / SIZE**2 - expected) < 5 * np.sqrt(expected) / SIZE).all()


@animation
def test_one_channel_used_twice_is_no_triangle():
    number = animated(ranks()[..., 0], 3)
    assert triangular(number, number).var() > 0.33


@animation
@pytest.mark.feature("noise/blue-noise")
def test_shaders_have_the_same_numbers_to_the_bit(either_device):
    from tests.support.either import evaluate

    frame = np.arange(SIZE**2, dtype=np.uint32).reshape(SIZE, SIZE) * np.uint32(3_000_017)
    given = {"rank": ranks().reshape(-1, 2).astype(np.uint32), "frame": frame.reshape(-1)}
    body = """
        numbers = vec2(animated_rank(rank.x, frame), animated_rank(rank.y, frame));
        total = triangular(numbers);
    """
    got = evaluate(either_device, ["blue_noise.glsl"], body, given, {"numbers": "vec2", "total": "float"})
    expected = animated(given["rank"], given["frame"][:, None])
    assert np.array_equal(got["numbers"].view(np.uint32), expected.view(np.uint32))
    # Both numbers are multiples of 2^-24, but their sum may round in its last place before 1 leaves.
    assert np.array_equal(got["total"], triangular(expected[:, 0], expected[:, 1]))
    assert got["numbers"].min() >= 0.0 and got["numbers"].max() < 1.0


def test_the_table_is_read_once_and_cannot_be_changed():
    assert blue_noise.ranks() is blue_noise.ranks()
    with pytest.raises(ValueError, match="read-only"):
        ranks()[0, 0] = 0
