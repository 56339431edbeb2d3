"""Low-discrepancy points against exact fractions, stratification, and their twins in GLSL."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from common.numerics.sampling import MAX_HAMMERSLEY, halton, hammersley, radical_inverse, radical_inverse_2

RNG = np.random.default_rng(3)
INDICES = np.concatenate(
    [
        np.arange(4096, dtype=np.uint32),
        RNG.integers(0, 2**32, 4096, dtype=np.uint32),
        np.array([2**24 - 1, 2**24, 2**31, 2**32 - 1], np.uint32),
    ]
)


def mirrored(index: int, base: int) -> Fraction:
    value, weight = Fraction(0), Fraction(1, base)
    while index:
        index, digit = divmod(index, base)
        value, weight = value + digit * weight, weight / base
    return value


@pytest.mark.feature("sampling/hammersley")
def test_the_first_values():
    assert radical_inverse_2([0, 1, 2, 3, 4]).tolist() == [0, 0.5, 0.25, 0.75, 0.125]
    assert radical_inverse([0, 1, 2, 3, 4], 2).tolist() == [0, 0.5, 0.25, 0.75, 0.125]
    assert hammersley(4).tolist() == [[0, 0], [0.25, 0.5], [0.5, 0.25], [0.75, 0.75]]


@pytest.mark.parametrize("base", [2, 3, 5, 10])
def test_radical_inverse_against_fractions(base):
    indices = [*range(300), 12_345_678, 2**32 - 1]
    truth = [float(mirrored(index, base)) for index in indices]
    np.testing.assert_allclose(radical_inverse(indices, base), truth, rtol=2**-52)


def test_base_2_in_float32_is_cut_to_24_bits():
    values = radical_inverse_2(INDICES)
    assert values.dtype == np.float32 and values.max() < 1.0
    for index, value in zip(INDICES[::37].tolist(), values[::37].tolist(), strict=True):
        assert value == int(mirrored(index, 2) * 2**24) / 2**24


@pytest.mark.parametrize("count", [16, 256, 4096])
def test_hammersley_points_are_stratified(count):
    """A (0, m, 2)-net: every elementary interval of area 1 / count holds one point."""
    points = hammersley(count)
    for bits in range(count.bit_length()):
        across, down = 1 << bits, count >> bits
        cells = np.floor(points[:, 0] * across) * down + np.floor(points[:, 1] * down)
        assert len(np.unique(cells)) == count


@pytest.mark.parametrize("count", [1, 3, 7, 1000, 3_000_001, MAX_HAMMERSLEY])
def test_hammersley_stays_below_one(count):
    points = hammersley(count)
    assert points.min() >= 0 and points.max() < 1.0
    assert len(np.unique(points[:, 0])) == count
    np.testing.assert_allclose(points[-1, 0], (count - 1) / count, rtol=2e-7)


def test_halton():
    points = halton(5, 3)
    assert points.tolist() == [[5 / 8, 7 / 9], [3 / 8, 2 / 9], [7 / 8, 5 / 9]]
    assert halton(0, 2, (2, 3, 5)).shape == (2, 3)


@pytest.mark.feature("sampling/hammersley")
def test_refused():
    with pytest.raises(ValueError, match="base 1"):
        radical_inverse([1], 1)
    for count in (0, MAX_HAMMERSLEY + 1):
        with pytest.raises(ValueError, match="Hammersley"):
            hammersley(count)


@pytest.mark.feature("sampling/hammersley")
@pytest.mark.parametrize("count", [4096, 1000, 7])
def test_glsl_gives_the_same_bits(either_device, count):
    from tests.support.either import evaluate

    index = np.arange(count, dtype=np.uint32)
    inverse = np.full(count, np.float32(1) / np.float32(count), np.float32)
    got = evaluate(
        either_device,
        ["sampling.glsl"],
        "point = hammersley(index, inverse); other = radical_inverse_2(wild);",
        inputs={"index": index, "inverse": inverse, "wild": np.resize(INDICES[::-1], count)},
        outputs={"point": "vec2", "other": "float"},
    )
    assert np.array_equal(got["point"], hammersley(count))
    assert np.array_equal(got["other"], radical_inverse_2(np.resize(INDICES[::-1], count)))
