"""What a frame costs in Python: the functions that it calls, and the CPU time of the thread that renders it.

The driver's part of that time is left out. `python_times` does not count what passes inside of the calls that submit a
frame and wait for one: a software driver copies what was recorded there, and the validation layer looks at all of it.
What is submitted is empty but for its semaphores: a software driver draws on the same cores, and its work drives
Python's memory out of their caches. (With draws the difference of chapters 8 and 9 was 14 to 90 us from run to run, and
10 to 12 us without them.)
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import pytest

import chapters
from common.numerics.transforms import pose_looking_at
from common.scene import Scene
from common.view.camera import Perspective, View
from tests.support.chapter import Chapter
from tests.support.shadows import PLAIN, point, spot, yard
from tests.support.timing import least_times

SIZE = (32, 24)
BUDGET_S = 3e-5
"""Seconds of Python that a lesson may add to a frame."""

LAMPS = spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8))

DRIVER = ("vkQueueSubmit2", "vkWaitSemaphores")
"""The calls of a recorded frame in which the driver works."""

VIEWS = [
    View(pose_looking_at((3.0 + 0.01 * step, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
    for step in range(8)
]


def lit_yard() -> Scene:
    """Return the yard of the tests of shadows with two lamps."""
    return yard(*LAMPS)


def chapter_before(chapter: Chapter) -> Chapter:
    """Return the chapter before, on the same device."""
    return Chapter(chapter.which - 1, chapter.backend, chapter.device)


@dataclass
class Walk:
    """Draws frames of a renderer, each from another place. All was recorded before, as in a window."""

    renderer: Any
    numbers: Iterator[int] = field(default_factory=itertools.count)

    def __post_init__(self) -> None:
        for _ in range(24):
            frame = self.draw()
        assert frame.work["recorded"] == 0

    def draw(self) -> Any:
        """Draw the next frame."""
        number = next(self.numbers)
        return self.renderer.render(VIEWS[number % len(VIEWS)], number / 60)

    def finish(self) -> None:
        """Wait until no frame is in flight, on Vulkan. The thread does not sleep: its caches stay its own."""
        for timeline in self.renderer._frames.pace.timelines.values():
            while not timeline.done(timeline.last):
                pass


@contextmanager
def walk(it: Chapter, scene: Scene, **turned: Any) -> Iterator[Walk]:
    """Yield a walk through a scene without shadows, with some settings."""
    settings = chapters.settings_class(it.which)(**PLAIN, shadows="off", **turned)
    with it.open(scene, SIZE, settings) as renderer:
        yield Walk(renderer)


def calls_of(walk: Walk, frames: int = 8) -> int:
    """Return how many functions Python calls in a frame, its own and those of C: the least of some frames."""
    count = 0

    def note(frame: object, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    counts = []
    for _ in range(frames):
        count = 0
        sys.setprofile(note)
        try:
            walk.draw()
        finally:
            sys.setprofile(None)
        counts.append(count)
    return min(counts)


def python_times(
    walks: Mapping[str, Walk],
    holds: Callable[[dict[str, float]], bool],
    monkeypatch: pytest.MonkeyPatch,
    seconds: float = 8.0,
) -> dict[str, float]:
    """Return for each walk on Vulkan the CPU seconds of a frame: the least of many means of four frames, in turns.

    They go on until `holds`, or for so many `seconds`. A frame in front of the four brings back to the caches what the
    other walks drove out. Frames draw nothing from here on.
    """
    clock, spent = time.thread_time, 0.0

    def without_driver(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            nonlocal spent
            began = clock()
            result = function(*arguments)
            spent += clock() - began
            return result

        return call

    (device,) = {walk.renderer.device for walk in walks.values()}
    submit = device.fn.vkQueueSubmit2

    def submit_nothing(queue: Any, count: int, infos: Any, fence: Any) -> Any:
        for number in range(count):
            infos[number].commandBufferInfoCount = 0
        return submit(queue, count, infos, fence)

    monkeypatch.setattr(device.fn, "vkQueueSubmit2", submit_nothing)
    for name in DRIVER:
        monkeypatch.setattr(device.fn, name, without_driver(getattr(device.fn, name)))

    def measured(walk: Walk) -> float:
        took = 0.0
        walk.draw()
        for _ in range(4):
            walk.finish()
            began = clock() - spent
            walk.draw()
            took += clock() - spent - began
        walk.finish()
        return took / 4

    measures = {name: partial(measured, walk) for name, walk in walks.items()}
    return least_times(measures, holds, fewest=10, seconds=seconds)
