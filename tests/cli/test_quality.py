"""`--quality auto`: the best preset that is fast enough, measured once."""

from __future__ import annotations

import pytest

from backends.contract import Capabilities
from tools.run import quality
from tools.run import run as running
from tools.run.quality import (
    CANDIDATES,
    GOAL_MS,
    MOST_PIXELS,
    choose,
    estimated_ms,
    frame_ms,
    key_of,
    measured_size,
)


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


def test_the_median_ignores_one_slow_frame(monkeypatch):
    now, calls = [0.0], []
    monkeypatch.setattr(quality.clock, "perf_counter", lambda: now[0])

    def draw():
        calls.append(None)
        now[0] += 0.05 if len(calls) in (1, 4) else 0.002

    assert frame_ms(draw) == pytest.approx(2.0)
    assert tuple(CANDIDATES) == ("high", "medium", "low")


@pytest.mark.parametrize("size", [(8192, 8192), (16384, 128), (16384, 16384), (1281, 720)])
def test_a_huge_window_is_judged_by_a_picture_of_bounded_size(size):
    width, height = measured_size(size)
    assert width * height <= 1.01 * MOST_PIXELS
    assert width / height == pytest.approx(size[0] / size[1], rel=0.05)
    assert estimated_ms(10.0, (width, height), size) == pytest.approx(
        10.0 * size[0] * size[1] / MOST_PIXELS, rel=0.02
    )


def test_a_usual_window_is_measured_as_it_is():
    for size in ((1, 1), (640, 360), (1280, 720)):
        assert measured_size(size) == size and estimated_ms(7.0, size, size) == 7.0


def test_slow_frames_are_few(monkeypatch):
    """Frames of 1.5 s, the first, in which drivers compile, of 4 s: two are drawn, and the second counts."""
    now, drawn = [0.0], []
    monkeypatch.setattr(quality.clock, "perf_counter", lambda: now[0])

    def draw():
        now[0] += 1.5 if drawn else 4.0
        drawn.append(now[0])

    assert frame_ms(draw) == pytest.approx(1500.0)
    assert len(drawn) == 2


@pytest.mark.feature("tools/presets")
@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_window_of_8192_pixels_is_chosen_for_soon_and_it_is_said(request, backend, monkeypatch):
    request.getfixturevalue("vulkan_instance" if backend == "vulkan" else "gl_context")
    from tests.support.scenes import quad_scene

    measured = []
    real = running.chapters.open

    def opened(*arguments, **options):
        measured.append(options["size"])
        return real(*arguments, **options | {"size": (8, 8)})

    monkeypatch.setattr(running.chapters, "open", opened)
    monkeypatch.setattr(quality, "frame_ms", lambda draw: 1.0)
    monkeypatch.setattr(quality, "cache_dir", lambda name: None)
    name, note = running.chosen_quality(running.Request(1, backend=backend, size=(8192, 8192)), quad_scene())
    assert name == "low"  # 1 ms for 960x960 is 73 ms for 8192x8192
    assert "judged by 960x960" in note and "quality low (73 ms a frame here" in note
    assert measured == [(960, 960)] * 3


def test_what_was_measured_holds_for_what_is_drawn_alone(vulkan_instance, monkeypatch):
    """A view is drawn faster than the picture, and a sky costs: neither decides about the other."""
    from tests.support.scenes import quad_scene

    keys = []
    monkeypatch.setattr(quality, "choose", lambda measure, key: (keys.append(key), ("low", 1.0))[1])
    changes = (
        {},
        {"view": "depth"},
        {"environment": "sky"},
        {"camera": "2,2,2:0,0,0"},
        {"without": ("all",)},
    )
    for change in (*changes, {"overrides": ("msaa=4",)}, {}):
        running.chosen_quality(running.Request(1, backend="vulkan", size=(8, 8), **change), quad_scene())
    assert keys[0] == keys[-1]
    assert len(set(keys)) == len(keys) - 1
