"""The table of blue noise: each rank once, in the place that void-and-cluster gives it, and blue in every direction.

The energy that decides about places is computed here anew for a rank, as a convolution in float64.
"""

from __future__ import annotations

import numpy as np
import pytest

from assets import blue_noise
from common.images import read_image
from common.numerics.blue_noise import SIZE, TABLE, ranks

FREQUENCY = np.hypot(*np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE)))
"""Cycles per texel of each bin of a spectrum of the table; 0.5 is the highest along an axis."""


def power(values):
    """Return the spectrum (H, W): white noise has a mean of 1 in all bins but the constant's, which is 0 here."""
    values = np.asarray(values, np.float64)
    values = values - values.mean()
    return np.abs(np.fft.fft2(values)) ** 2 / (values.size * values.var())


def improbable(mean, bins):
    """Return -ln of a bound of the probability that white noise has so little power in so many bins.

    The powers of half the bins are independent and exponential with mean 1 (the other half are their mirror images).
    For n of them P(mean <= x) <= exp(-n (x - 1 - ln x)) if x < 1 (Chernoff).
    """
    return bins / 2 * (mean - 1 - np.log(mean))


def energies(inside):
    """Return the energy (H, W) around a pattern on the torus, in float64."""
    near = np.minimum(np.arange(len(inside)), len(inside) - np.arange(len(inside)))
    around = np.exp(-(near[:, None] ** 2 + near**2) / (2 * 1.5**2))
    return np.fft.ifft2(np.fft.fft2(inside) * np.fft.fft2(around)).real


def misplaced(table, which):
    """Return the ranks among `which` that are not where a void or a cluster is.

    Transforms round to 1e-13 or so and the generator to 2^-42 a texel; energies less than 1e-10 apart are equal.
    """
    first, wrong = blue_noise.first_count(len(table)), []
    for rank in which:
        place = table == rank
        if rank >= first:
            energy = energies(table < rank)
            right = energy[place] <= energy[table >= rank].min() + 1e-10
        else:
            energy = energies(table <= rank)
            right = energy[place] >= energy[table <= rank].max() - 1e-10
        wrong += [] if right else [rank]
    return wrong


@pytest.mark.feature("noise/blue-noise")
def test_each_channel_has_each_rank_once():
    assert ranks().shape == (SIZE, SIZE, 2)
    for channel in range(2):
        assert np.array_equal(np.sort(ranks()[..., channel], axis=None), np.arange(SIZE**2))


@pytest.mark.feature("noise/blue-noise")
def test_the_file_is_what_the_generator_makes():
    """To the last bit, on every processor: energies are whole numbers."""
    assert np.array_equal(read_image(TABLE), blue_noise.source(0))
    assert TABLE.stat().st_size < 65_536


@pytest.mark.parametrize("size", [2, 3, 16, 25])
def test_every_rank_of_a_small_table_is_in_a_void_or_a_cluster(size):
    table = blue_noise.void_and_cluster(size, 7)
    assert np.array_equal(np.sort(table, axis=None), np.arange(size**2))
    assert misplaced(table, range(size**2)) == []


def test_every_97th_rank_of_the_file_is_in_a_void_or_a_cluster():
    for channel in range(2):
        assert misplaced(ranks()[..., channel], range(0, SIZE**2, 97)) == []


@pytest.mark.long
def test_every_rank_of_the_file_is_in_a_void_or_a_cluster():
    for channel in range(2):
        assert misplaced(ranks()[..., channel], range(SIZE**2)) == []


def test_misplaced_ranks_are_found():
    table = blue_noise.void_and_cluster(16, 7)
    swapped = np.where(table == 100, 200, np.where(table == 200, 100, table))
    assert 100 in misplaced(swapped, range(256))
    assert len(misplaced(np.random.default_rng(1).permutation(256).reshape(16, 16), range(256))) > 200


@pytest.mark.parametrize("size", [16, 32])
def test_the_first_pattern_rests(size):
    """Without its tightest cluster the largest void is where that was."""
    table = blue_noise.void_and_cluster(size, 5)
    first = blue_noise.first_count(size)
    inside = table < first
    cluster = np.argmax(np.where(inside, energies(inside), -1))
    rest = inside.copy()
    rest.reshape(-1)[cluster] = False
    energy = energies(rest)
    assert energy.reshape(-1)[cluster] <= energy[~rest].min() + 1e-10


def blue(table):
    """Fail unless the spectrum of ranks is that of blue noise, by bounds that white noise cannot meet."""
    spectrum = power(table)
    for radius, most in ((0.1, 0.001), (0.2, 0.01), (0.25, 0.02)):
        low = (FREQUENCY > 0) & (radius >= FREQUENCY)
        assert spectrum[low].mean() <= most, f"below {radius} cycles a texel"
        assert improbable(most, low.sum()) > 1000, "a bound that white noise might meet says nothing"
    # The power that is missing there is above: the mean of all bins is 1.
    assert spectrum[FREQUENCY > 0.3].mean() > 1.2


@pytest.mark.feature("noise/blue-noise")
def test_there_is_next_to_no_power_at_low_frequencies():
    for channel in range(2):
        blue(ranks()[..., channel])
    with pytest.raises(AssertionError, match="cycles"):
        blue(np.random.default_rng(3).permutation(SIZE**2).reshape(SIZE, SIZE))


@pytest.mark.feature("noise/blue-noise")
@pytest.mark.long
@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_sources_for_effects_of_one_sample_a_pixel_are_as_blue(number):
    other = blue_noise.source(number)
    for channel in range(2):
        assert np.array_equal(np.sort(other[..., channel], axis=None), np.arange(SIZE**2))
        blue(other[..., channel])
        for table in np.moveaxis(ranks(), -1, 0):
            assert alike(other[..., channel], table) < 6 / SIZE


def test_no_direction_is_preferred():
    """An eighth of a ring has the mean power of the whole ring within five standard deviations.

    Bins of blue noise are not quite independent, so the deviation is measured: over the eighths of all rings.
    """
    angle = np.arctan2(*np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE), indexing="ij")) % np.pi
    eighth = np.minimum((angle * 8 / np.pi).astype(int), 7)
    for channel in range(2):
        spectrum = power(ranks()[..., channel])
        for inner in (0.25, 0.3, 0.35, 0.4, 0.45):
            ring = (inner < FREQUENCY) & (inner + 0.05 >= FREQUENCY)
            bins = np.array([(ring & (eighth == k)).sum() for k in range(8)])
            means = np.array([spectrum[ring & (eighth == k)].mean() for k in range(8)])
            # The mean of n / 2 independent exponential numbers of mean 1 deviates by sqrt(2 / n).
            assert (np.abs(means / spectrum[ring].mean() - 1) < 5 * np.sqrt(2 / bins)).all()


def test_a_preferred_direction_is_found():
    """Every second column of another table: its ring differs from direction to direction."""
    spectrum = power(np.repeat(ranks()[::2, ..., 0], 2, axis=0))
    rows, columns = (
        spectrum[SIZE // 2 - 8 : SIZE // 2 + 8, :8].mean(),
        spectrum[:8, SIZE // 2 - 8 :][:, :16].mean(),
    )
    assert abs(rows / columns - 1) > 0.5


@pytest.mark.feature("noise/blue-noise")
@pytest.mark.parametrize("level", [1 / 64, 1 / 32, 1 / 16])
def test_texels_below_a_low_level_are_spread_evenly_across_seams_too(level):
    """No two on the torus lie nearer than half the distance of a hexagonal lattice, sqrt(2 / (sqrt(3) density)).

    Of n texels at random, n^2 / 2 * 8 / SIZE^2 pairs are neighbours: 16 for a 64th. At higher levels half the distance
    is that of neighbours.
    """
    for table in np.moveaxis(ranks(), -1, 0):
        places = np.argwhere(table < level * SIZE**2)
        assert len(places) == level * SIZE**2
        away = np.abs(places[:, None] - places)
        away = np.minimum(away, SIZE - away)
        distance = np.hypot(away[..., 0], away[..., 1]) + 1e9 * np.eye(len(places))
        assert distance.min() >= 0.5 * np.sqrt(2 / (np.sqrt(3) * level))


def test_a_seam_is_a_row_like_any_other():
    """The mean step of rank from the last row to the first lies among the steps between other rows.

    Neighbours of blue noise differ more than independent ranks, whose mean step is a third of all: rows that are not
    neighbours have that.
    """
    for table in np.moveaxis(ranks().astype(np.float64), -1, 0):
        for axis in (0, 1):
            rows = np.moveaxis(table, axis, 0)
            steps = np.abs(rows - np.roll(rows, 1, 0)).mean(axis=1)
            assert abs(steps[0] - steps[1:].mean()) < 3 * steps[1:].std()
            elsewhere = np.abs(rows - np.roll(rows, 57, 0)).mean()
            assert abs(elsewhere / (SIZE**2 / 3) - 1) < 0.02
            assert steps[0] > 1.1 * elsewhere


def alike(first, second):
    """Return the largest correlation of two tables, over all shifts of one against the other."""
    spectra = [
        np.fft.fft2(table - np.mean(table)) for table in (np.asarray(first, float), np.asarray(second, float))
    ]
    scale = np.std(first) * np.std(second) * np.size(first)
    return np.abs(np.fft.ifft2(spectra[0] * np.conj(spectra[1])).real).max() / scale


def test_channels_have_nothing_to_do_with_each_other():
    """Correlations deviate by sqrt(mean of the product of spectra) / SIZE, 1.2 / SIZE; six such for 2^14 shifts."""
    assert alike(ranks()[..., 0], ranks()[..., 1]) < 6 / SIZE
    assert alike(ranks()[..., 0], np.roll(ranks()[..., 0], (3, 70), (0, 1))) > 0.999


@pytest.mark.feature("noise/blue-noise")
@pytest.mark.parametrize("value", [0.1, 0.5, 0.77])
def test_the_error_of_one_sample_a_texel_is_of_high_frequency(value):
    """A constant in 0..1 becomes 0 or 1 by comparison with the table: its mean stays, its error is blue."""
    for table in np.moveaxis(ranks(), -1, 0):
        sampled = (table + 0.5) / SIZE**2 < value
        assert abs(sampled.mean() - value) <= 0.5 / SIZE**2 + 1e-12
        low = (FREQUENCY > 0) & (FREQUENCY <= 0.1)
        assert power(sampled)[low].mean() < 0.1
        assert improbable(0.1, low.sum()) > 300


def test_sizes_that_ranks_do_not_hold_are_refused():
    for size in (0, 1, 129):
        with pytest.raises(ValueError, match="2 to 128 texels"):
            blue_noise.void_and_cluster(size, 1)
