"""Draws cut into parts: every call in exactly one of them, in order, with all that is bound for it; and the threads."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from chapters.ch03.frames.recording.parts import DrawList, Groups, part_count, pool_index
from chapters.ch03.scene.draw_lists import Batch
from chapters.ch03.tasks.errors import TaskError
from chapters.ch03.tasks.scheduler import split
from chapters.ch03.tasks.workers import Workers
from tests.support.timing import PATIENCE_S

pytestmark = pytest.mark.usefixtures("no_thread_left")


@dataclass(frozen=True)
class Group:
    """What either backend's group of draws has in common, and something that must stay with it."""

    batch: Batch
    pipeline: int


class Recorder:
    """Has the methods of a backend's commands; keeps each call and draw."""

    def __init__(self) -> None:
        self.made: list[tuple[Any, ...]] = []
        self.triangles = 0
        self.sources: Any = None

    def draw_fullscreen(self, *arguments: Any) -> None:
        """Keep the call, and what the pass reads of others."""
        self.made.append(("draw_fullscreen", *arguments, self.sources))

    def draw_groups(self, groups: list[Group], *where: Any) -> None:
        """Keep each draw, with what it is drawn with."""
        assert groups and all(group.batch.count > 0 for group in groups)
        for group in groups:
            first, count = group.batch.first, group.batch.count
            self.made += [("draw", number, group.pipeline, *where) for number in range(first, first + count)]
            self.triangles += group.batch.triangles


def groups_of(counts: list[int], first: int = 0) -> list[Group]:
    """Return groups of so many draws, one behind the other, of three triangles each."""
    starts = first + np.r_[0, np.cumsum(counts)]
    return [
        Group(Batch(0, False, 0, 0, int(start), count, 3 * count), number)
        for number, (start, count) in enumerate(zip(starts[:-1], counts, strict=True))
    ]


@pytest.mark.feature("recording/command-pools")
def test_every_frame_and_thread_has_a_pool_of_its_own_and_every_pool_an_owner():
    for frames, threads in ((1, 1), (2, 5), (3, 4)):
        found = [pool_index(frame, thread, threads) for frame in range(frames) for thread in range(threads)]
        assert sorted(found) == list(range(frames * threads))
    for frame, thread in ((0, 4), (0, -1), (-1, 0)):
        with pytest.raises(ValueError, match="have no pool"):
            pool_index(frame, thread, 4)


def test_parts_have_at_least_so_many_calls_and_one_part_is_none():
    assert [part_count(calls, 10) for calls in (0, 9, 10, 19, 20, 29, 30, 1000)] == [0, 0, 0, 0, 2, 2, 3, 100]
    for calls in range(20, 400):
        assert all(last - first >= 10 for first, last in split(calls, part_count(calls, 10)))


@pytest.mark.feature("recording/parallel-draws")
@pytest.mark.parametrize("multi_draw", [True, False])
def test_parts_put_together_are_the_whole_list(multi_draw):
    """Solid groups, a sky with its own binds, transparent groups: cut in any way, nothing is lost, doubled or moved."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        counts = rng.integers(1, 7, rng.integers(0, 6)).tolist()
        clear = rng.integers(1, 4, rng.integers(0, 6)).tolist()
        draws, direct = DrawList(multi_draw), Recorder()
        for into in (draws, direct):
            into.draw_groups(groups_of(counts), "scene") if counts else None
            if into is draws:
                draws.draw_fullscreen("sky", "scene", "sources")
            else:
                direct.sources = "sources"
                direct.draw_fullscreen("sky", "scene")
            into.draw_groups(groups_of(clear, sum(counts)), "scene") if clear else None
        assert draws.calls == (len(counts) + 1 + len(clear) if multi_draw else sum(counts) + 1 + sum(clear))
        for parts in range(1, draws.calls + 1):
            pieces = []
            for first, last in split(draws.calls, parts):
                pieces.append(Recorder())
                draws.record(pieces[-1], first, last)
                made = [call[0] for call in pieces[-1].made]
                drawn = made.count("draw_fullscreen") + (0 if multi_draw else made.count("draw"))
                assert multi_draw or drawn == last - first
            assert [call for piece in pieces for call in piece.made] == direct.made
            assert sum(piece.triangles for piece in pieces) == direct.triangles


def test_no_groups_are_no_calls():
    draws = DrawList(multi_draw=False)
    draws.draw_groups([], "set")
    assert draws.calls == 0 and Groups([], multi_draw=False).end == 0
    draws.record(object(), 0, 0)


# --- the threads ------------------------------------------------------------------------------------------------------


def test_threads_start_when_there_is_something_to_share_and_end_with_their_renderer():
    before = threading.active_count()
    workers = Workers(2)
    assert threading.active_count() == before
    done: list[int] = []
    workers.share("count", lambda first, last, _: done.extend(range(first, last)), 10, 4)
    assert sorted(done) == list(range(10)) and threading.active_count() > before
    workers.close()
    workers.close()
    assert threading.active_count() == before
    with pytest.raises(RuntimeError, match="closed"):
        _ = workers.tasks


def test_when_sharing_is_interrupted_no_part_runs_on():
    """Ctrl-C meets the thread that waits, while a worker is in the middle of its part."""
    workers, both, ended = Workers(1), threading.Barrier(2, timeout=PATIENCE_S), []

    def work(first: int, last: int, thread: int) -> None:
        if first < 2:
            both.wait()  # the first two parts run at the same time, each on a thread
        if thread == 0:
            raise KeyboardInterrupt
        time.sleep(0.3)  # so that the other thread is interrupted long before this part ends
        ended.append(first)

    with pytest.raises(KeyboardInterrupt):
        workers.share("record", work, 8, 8)
    ran = list(ended)
    assert len(ran) == 1
    time.sleep(0.35)
    assert ended == ran
    workers.close()


def test_a_part_that_fails_is_named():
    workers = Workers(1)

    def work(first: int, last: int, _: int) -> None:
        if first == 5:
            raise ValueError("no such page")

    with pytest.raises(TaskError, match=r"'record forward\[5:10\]'.*no such page") as caught:
        workers.share("record forward", work, 10, 2)
    assert isinstance(caught.value.__cause__, ValueError)
    workers.close()
