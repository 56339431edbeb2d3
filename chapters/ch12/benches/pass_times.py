"""How long passes of a frame take: by timestamps, and on software drivers by the clock.

A software driver draws on the processor, and its timestamps do not wait for all of its work. There a pass is recorded
several times in a frame: what the frame then takes longer, divided by the added times, is the time of the pass. That
changes no result for passes that write the same again.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from common.reports.benches import Subject, middle
from common.view.camera import View

MORE = 2
"""How many times more a pass is recorded."""

Groups = Mapping[str, tuple[str, ...]]
"""Beginnings of the names of passes, by what they are called together."""

Times = dict[str, tuple[float, float]]
"""The time of each group in ms, and its noise: the median by timestamps, the least by the clock."""


def is_software(subject: Subject) -> bool:
    """Whether the subject's device is a software driver."""
    return bool(subject.device.capabilities.kind == "software")


def times_of(renderer: Any, views: Iterator[View], groups: Groups, frames: int, software: bool) -> Times:
    """Return the times of groups of passes over some frames; (0, 0) for a group without passes in the frame."""
    return (_by_clock if software else _by_stamps)(renderer, views, groups, frames)


def _by_stamps(renderer: Any, views: Iterator[View], groups: Groups, frames: int) -> Times:
    found: dict[str, list[float]] = {group: [] for group in groups}
    for _ in range(frames):
        passes = renderer.render(next(views)).timings
        for group, beginnings in groups.items():
            found[group].append(sum(took for name, took in passes.items() if name.startswith(beginnings)))
    return {group: middle(times) for group, times in found.items()}


def _by_clock(renderer: Any, views: Iterator[View], groups: Groups, frames: int) -> Times:
    made = {
        group: [one for one in renderer.passes if one.name.startswith(beginnings)]
        for group, beginnings in groups.items()
    }
    plain = _walls(renderer, views, frames)
    more: dict[str, list[float]] = {}
    for group, passes in made.items():
        if passes:
            with recorded_by(renderer, passes, _several_times):
                more[group] = _walls(renderer, views, frames)
    plain += _walls(renderer, views, frames)  # a machine is not alike busy before and after
    return {group: _longer(more[group], plain) if group in more else (0.0, 0.0) for group in groups}


def _longer(more: list[float], plain: list[float]) -> tuple[float, float]:
    """Return the time of a group by the quickest frames, which a busy machine disturbs least, and its noise."""
    noise = math.hypot(middle(more)[1], middle(plain)[1])
    return max(min(more) - min(plain), 0.0) / MORE, noise / MORE


def _walls(renderer: Any, views: Iterator[View], frames: int) -> list[float]:
    """Return ms of frames by the clock. The frame before them is recorded anew."""
    walls = []
    for number in range(1 + frames):
        began = clock.perf_counter()
        len(renderer.render(next(views)).timings)  # waits for the frame
        if number:
            walls.append((clock.perf_counter() - began) * 1e3)
    return walls


Record = Callable[[Any], None]


def _several_times(record: Record) -> Record:
    def recorded(commands: Any) -> None:
        for _ in range(1 + MORE):
            record(commands)

    return recorded


@contextmanager
def recorded_by(renderer: Any, passes: Sequence[Any], way: Callable[[Record], Record]) -> Iterator[None]:
    """Record passes in another way; `way` gets what records one."""
    for one in passes:
        one.record = way(one.record)
    renderer._frames.forget()
    try:
        yield
    finally:
        for one in passes:
            del one.record
        renderer._frames.forget()
