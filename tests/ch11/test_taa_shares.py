"""The share of each frame in the history: the weights of all frames in the end, from the shares alone."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.taa.model import RESIDUE, REST_PERIODS, SETTLING_SHARE, Shares

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
def test_equal_frames_after_others_weigh_the_same_and_the_others_the_residue():
    shares = Shares(0.1, PERIOD, averages=True)
    moving = [shares.next(still=False, valid=n > 0) for n in range(12)]
    assert moving[:3] == [1.0, 1 / 2, 1 / 3] and moving[-1] == 0.1
    equal = []
    while not shares.resting:
        equal.append(shares.next(True, True))
    assert min(equal[: PERIOD - 1]) == SETTLING_SHARE
    assert len(equal) == WHOLE + PERIOD - 1  # the last frame of those that moved shows the same as well
    of_all = weights(moving + equal)
    assert of_all.sum() == pytest.approx(1.0)
    assert np.allclose(of_all[-WHOLE:], (1 - RESIDUE) / WHOLE, rtol=1e-12)
    assert of_all[:-WHOLE].sum() == pytest.approx(RESIDUE)


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
