"""Tables of aliases: exact in whole numbers, against counting by hand, and bad weights refused."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from common.numerics.alias_table import MAX_WEIGHTS, alias_table

feature = pytest.mark.feature("path-tracer/environment-alias-table")
FULL = 2**32


def drawn(table):
    """Return the exact probability of each number, by going through the entries one by one."""
    entries = len(table.threshold)
    result = [Fraction(0)] * entries
    for entry in range(entries):
        own, alias = int(table.threshold[entry]), int(table.alias[entry])
        result[entry] += Fraction(own, FULL * entries)
        result[alias] += Fraction(FULL - own, FULL * entries)
    return result


def weights(kind, count, rng):
    """Return weights of one kind; at least one is above 0."""
    given = {
        "even": np.ones(count),
        "random": rng.random(count),
        "wide": 10.0 ** rng.uniform(-200, 200, count),
        "holes": np.float64(rng.random(count) < 0.3),
        "small whole": np.float64(rng.integers(0, 4, count)),
    }[kind]
    given[0] = given[0] or 1.0
    return given


@feature
@pytest.mark.parametrize("kind", ["even", "random", "wide", "holes", "small whole"])
def test_every_number_is_drawn_with_the_share_of_its_weight(kind):
    rng = np.random.default_rng(8)
    for count in (1, 2, 3, 4, 5, 8, 31, 64, 100, 257):
        given = weights(kind, count, rng)
        table = alias_table(given)
        probabilities = drawn(table)
        assert sum(probabilities) == 1
        assert [float(p) for p in probabilities[:count]] == table.probability.tolist()
        assert not any(probabilities[count:]), "an entry without a weight is never drawn"
        total = sum(Fraction(w) for w in given.tolist())
        entries = len(table.threshold)
        assert entries < 2 * count or count == 1
        for p, w in zip(probabilities, given.tolist(), strict=False):
            share = Fraction(w) / total
            assert abs(p - share) <= 2 * max(share, Fraction(1, entries)) / FULL
            assert (p == 0) == (w == 0)


@feature
def test_a_table_by_hand():
    """Weights 1, 3, 4 and none are 1/2, 3/2, 2 and 0 of four entries: entry 1 fills up 0, and entry 2 fills up 3."""
    table = alias_table([1, 3, 4])
    assert table.units.tolist() == [FULL // 2, 3 * FULL // 2, 2 * FULL]
    assert table.threshold.tolist() == [FULL // 2, FULL - 1, FULL - 1, 0]
    assert table.alias.tolist() == [1, 1, 2, 2]
    words = table.words()
    assert words.dtype == np.uint32 and words.shape == (4, 4)
    assert words[:, 2].copy().view(np.float32).tolist() == [0.125, 0.375, 0.5, 0.0]
    assert words[:, 3].copy().view(np.float32).tolist() == [0.375, 0.375, 0.5, 0.5]


@feature
def test_a_map_s_table_is_exact():
    """As many weights as a cube map of 128 texels has, over ten orders of magnitude; sums in whole numbers."""
    rng = np.random.default_rng(1)
    given = 10.0 ** rng.uniform(-10, 0, 6 * 128 * 128)
    table = alias_table(given)
    entries = len(table.threshold)
    own = table.threshold.astype(np.int64)
    own[table.alias == np.arange(entries)] = FULL
    sums = own.copy()
    np.add.at(sums, table.alias, FULL - own)
    assert np.array_equal(sums[: len(given)], table.units) and not sums[len(given) :].any()
    assert int(table.units.sum()) == entries * FULL
    share = given / given.sum()
    assert (np.abs(table.probability - share) <= 2**-31 * np.maximum(share, 1 / entries)).all()
    assert np.abs(table.words()[: len(given), 2].copy().view(np.float32) / table.probability - 1).max() < 1e-7


@feature
@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ([], "1 to"),
        (np.ones((2, 2)), "in a row"),
        ([1.0, -1e-9], "not negative"),
        ([1.0, np.nan], "finite"),
        ([1.0, np.inf], "finite"),
        ([0.0, 0.0], "above 0"),
        (np.broadcast_to(1.0, MAX_WEIGHTS + 1), "1 to 16777216"),
    ],
)
def test_weights_that_cannot_be_are_refused(given, sentence):
    with pytest.raises(ValueError, match=sentence):
        alias_table(given)
