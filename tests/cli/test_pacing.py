"""Frames in a row: which renderers are told how long their frames take, and when."""

from __future__ import annotations

from typing import Any

from backends.pacing import Paced
from tools.run.pacing import LATENCY, Pacer


class FakeFrame:
    """A frame whose times are known once the renderer has used its slot again."""

    def __init__(self, renderer: Any, number: int) -> None:
        self._renderer, self._number = renderer, number

    @property
    def timings(self) -> dict[str, float]:
        assert self._renderer.drawn >= self._number + LATENCY, "reading would wait for the frame"
        return {"first": self._number + 0.25, "second": 0.5}


class Plain:
    """A renderer that counts its frames."""

    drawn = 0

    def render(self, view: Any, time: float) -> Any:
        self.drawn += 1
        return FakeFrame(self, self.drawn - 1)


class Following(Plain):
    """A renderer that notes what it is told, and how many frames were drawn by then."""

    def __init__(self) -> None:
        self.told: list[tuple[float, int]] = []

    def pace(self, frame_ms: float) -> None:
        self.told.append((frame_ms, self.drawn))


def test_a_renderer_is_told_the_sum_of_each_frame_two_frames_later_before_the_next():
    pacer, renderer = Pacer(), Following()
    frames = [pacer.render(renderer, None, 0.1 * n) for n in range(5)]
    assert renderer.told == [(0.75, 2), (1.75, 3), (2.75, 4)]
    assert [frame._number for frame in frames] == [0, 1, 2, 3, 4]


def test_other_renderers_are_told_nothing_and_no_times_are_read():
    pacer, renderer = Pacer(), Plain()
    assert not isinstance(renderer, Paced) and isinstance(Following(), Paced)
    for n in range(5):
        pacer.render(renderer, None, n)
    assert renderer.drawn == 5


def test_another_renderer_is_not_told_of_frames_that_it_did_not_draw():
    """As after a change of settings in a window."""
    pacer, first, second = Pacer(), Following(), Following()
    for renderer in (first, first, second, second, second):
        pacer.render(renderer, None, 0.0)
    assert first.told == [] and second.told == [(0.75, 2)]
