"""`--quality auto`: the best preset that is fast enough, measured once."""

from __future__ import annotations

import time

import pytest

from backends.contract import Capabilities
from chapters.quality import CANDIDATES, GOAL_MS, choose, frame_ms, key_of


@pytest.mark.parametrize(
    ("times", "best"),
    [
        ({"high": 10, "medium": 5, "low": 2}, "high"),
        ({"high": GOAL_MS, "medium": 5, "low": 2}, "high"),
        ({"high": 90, "medium": 49, "low": 2}, "medium"),
        ({"high": 90, "medium": 80, "low": 30}, "low"),
        ({"high": 900, "medium": 800, "low": 300}, "low"),  # nothing is fast enough: the fastest
    ],
)
def test_the_best_that_is_fast_enough(tmp_path, times, best):
    assert choose(times.__getitem__, "key", folder=tmp_path) == (best, times[best])


def test_it_is_measured_once_for_each_key(tmp_path):
    asked = []

    def measure(name):
        asked.append(name)
        return 10.0

    for key in ("a", "a", "b", "a"):
        assert choose(measure, key, folder=tmp_path) == ("high", 10.0)
    assert asked == ["high", "high"]
    choose(measure, None, folder=tmp_path)
    assert len(asked) == 3


@pytest.mark.parametrize("text", ["", "{", "[]", '{"preset": "best", "ms": 1}', '{"preset": "low"}'])
def test_a_broken_record_is_measured_anew(tmp_path, text):
    choose(lambda name: 1.0, "key", folder=tmp_path)
    (kept,) = tmp_path.iterdir()
    kept.write_text(text)
    assert choose(lambda name: 90.0 if name == "high" else 1.0, "key", folder=tmp_path) == ("medium", 1.0)


def test_another_driver_or_size_is_another_key():
    def capabilities(driver):
        return Capabilities("vulkan", "card", driver, (1, 3, 0), "discrete", frozenset())

    keys = {
        key_of(1, capabilities("1"), "atrium", (4, 4), ""),
        key_of(1, capabilities("2"), "atrium", (4, 4), ""),
        key_of(1, capabilities("1"), "atrium", (4, 5), ""),
        key_of(1, capabilities("1"), "spheres", (4, 4), ""),
        key_of(1, capabilities("1"), "atrium", (4, 4), "anisotropy=2"),
    }
    assert len(keys) == 5


def test_the_median_ignores_one_slow_frame():
    calls = []

    def draw():
        calls.append(None)
        time.sleep(0.05 if len(calls) in (1, 4) else 0.002)

    assert 2.0 <= frame_ms(draw) < 30.0
    assert tuple(CANDIDATES) == ("high", "medium", "low")
