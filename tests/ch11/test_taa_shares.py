"""The share of each frame in the history: the weights of all frames in the end, from the shares alone."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.taa.model import FRAMES_BEFORE, RESIDUE, REST_PERIODS, SETTLING_SHARE, Shares, short_means

PERIOD = 4
WHOLE = REST_PERIODS * PERIOD


def weights(shares):
    """Return the weight of each frame in the last picture: its share times what later frames left of it."""
    left = np.cumprod((1 - np.array(shares))[::-1])[::-1]
    return np.array(shares) * np.append(left[1:], 1.0)


@pytest.mark.feature("taa/history")
def test_equal_frames_from_the_start_weigh_the_same():
    shares = Shares(0.1, PERIOD, averages=True)
    all_ = [shares.next(still=n > 0, valid=n > 0) for n in range(WHOLE)]
    assert np.allclose(weights(all_), 1 / WHOLE, rtol=1e-12) and shares.resting
    assert [shares.next(True, True) for _ in range(3)] == [0.0] * 3


@pytest.mark.feature("taa/history")
@pytest.mark.parametrize("period", [1, 2, PERIOD, 8, 36, 64])
def test_equal_frames_after_others_weigh_the_same_by_the_place_in_their_period(period):
    """All points of the jitter have the same weight in the end, and the frames before have the residue at most.

    A mean begins with a share of 1 / (FRAMES_BEFORE + 1), never with a larger one.
    """
    shares = Shares(0.1, period, averages=True)
    moving = [shares.next(still=False, valid=n > 0) for n in range(12)]
    assert moving[:3] == [1.0, 1 / 2, 1 / 3] and moving[-1] == 0.1
    equal, begins = [], []
    while not shares.resting:
        equal.append(shares.next(True, True))
        begins.append(shares.begins)
    settling = period - 1  # the last frame of those that moved shows the same as well
    means = len(equal) - settling
    assert means == (short_means(period) + REST_PERIODS) * period
    assert set(equal[:settling]) <= {SETTLING_SHARE}
    assert max(equal) == pytest.approx(1 / (FRAMES_BEFORE + 1))
    assert np.flatnonzero(begins).tolist() == [settling + n * period for n in range(short_means(period) + 1)]
    of_all = weights(moving + equal)
    assert of_all.sum() == pytest.approx(1.0)
    by_place = of_all[-means:].reshape(-1, period).sum(axis=0)
    before = of_all[:-means].sum()
    assert np.allclose(by_place, (1 - before) / period, rtol=1e-12)
    assert np.allclose(of_all[-REST_PERIODS * period :], of_all[-1], rtol=1e-12)
    assert 0.0 < before <= RESIDUE


@pytest.mark.feature("taa/history")
def test_a_movement_or_a_lost_history_begins_anew():
    shares = Shares(0.1, PERIOD, averages=True)
    for n in range(WHOLE):
        shares.next(n > 0, n > 0)
    assert shares.next(still=False, valid=True) == 0.1 and not shares.resting
    assert shares.next(still=True, valid=False) == 1.0 and shares.age == 1


@pytest.mark.feature("taa/history")
def test_without_means_the_share_is_fixed_and_nothing_rests():
    shares = Shares(0.3, PERIOD, averages=False)
    assert [shares.next(n > 0, n > 0) for n in range(60)] == [1.0] + [0.3] * 59
    assert not shares.resting and not shares.averaging
