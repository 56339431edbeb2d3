"""The block profiler on a written-down timer, captures, the switch, and frames per second."""

from __future__ import annotations

import itertools
import json
import random
import threading
from collections.abc import Iterator

import pytest

from common.errors import UserError
from common.reports import profiling
from common.reports.profiling import (
    BlockProfiler,
    FpsCounter,
    NullProfiler,
    Record,
    UnbalancedError,
    load_capture,
)


@pytest.fixture(autouse=True)
def _switched_off_afterwards() -> Iterator[None]:
    before = profiling.use(NullProfiler())
    yield
    profiling.use(before)


SEED = 7  # of a tree with more than twenty blocks


def work(rng: random.Random, depth: int = 0) -> int:
    """A random tree of blocks through the facade; returns how many."""
    count = 0
    for number in range(rng.randrange(1, 4)):
        with profiling.block(f"{depth}.{number}"):
            count += 1
            if depth < 4 and rng.random() < 0.7:
                count += work(rng, depth + 1)
    return count


@pytest.mark.feature("profiling/cpu-blocks")
def test_a_tree_by_hand():
    times = iter([100, 110, 120, 150, 160, 190, 200])
    profiler = BlockProfiler(lambda: next(times))
    with profiler.block("frame"):
        with profiler.block("cull"):
            pass
        profiler.push("draw")
        profiler.pop()
    assert profiler.records() == [
        Record("frame", 10, 90, 0, 0),
        Record("cull", 20, 30, 1, 0),
        Record("draw", 60, 30, 1, 0),
    ]


@pytest.mark.feature("profiling/cpu-blocks")
@pytest.mark.parametrize("coarse", [1, 10_000_000])
def test_children_sum_to_their_parent_at_most(coarse):
    ticks = itertools.count()
    profiler = BlockProfiler(lambda: next(ticks) // coarse)  # the second timer stands still
    profiling.use(profiler)
    count = work(random.Random(SEED))
    records = profiler.records()
    assert len(records) == count > 20
    depths = [-1, *(record.depth for record in records)]
    assert all(after <= before + 1 for before, after in itertools.pairwise(depths)), "parents before children"
    for parent, record in enumerate(records):
        children = []
        for other in records[parent + 1 :]:
            if other.depth <= record.depth:
                break
            assert record.start_ns <= other.start_ns and other.end_ns <= record.end_ns
            if other.depth == record.depth + 1:
                children.append(other.duration_ns)
        assert sum(children) <= record.duration_ns


@pytest.mark.feature("profiling/cpu-blocks")
def test_unbalanced_blocks_raise(tmp_path):
    profiler = BlockProfiler()
    with pytest.raises(UnbalancedError, match="never begun"):
        profiler.pop()
    profiler.push("frame")
    with pytest.raises(UnbalancedError, match="'frame' is still open"):
        profiler.save(tmp_path / "capture.json")
    profiler.pop()
    with pytest.raises(UnbalancedError):
        profiler.pop()
    with pytest.raises(KeyError), profiler.block("fails"):
        raise KeyError
    assert [record.name for record in profiler.records()] == ["frame", "fails"]
    assert not any(tmp_path.iterdir())


@pytest.mark.feature("profiling/cpu-blocks")
def test_a_capture_loads_back_equal(tmp_path):
    profiler = BlockProfiler()
    profiling.use(profiler)
    work(random.Random(1))
    threads = [threading.Thread(target=work, args=(random.Random(seed),)) for seed in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    profiler.save(tmp_path / "capture.json")
    assert load_capture(tmp_path / "capture.json") == profiler.records()
    assert {record.thread for record in profiler.records()} >= {0, 1}
    events = json.loads((tmp_path / "capture.json").read_text())["traceEvents"]
    assert events[0].keys() == {"name", "ph", "pid", "tid", "ts", "dur", "args"} and events[0]["ph"] == "X"


def test_times_of_a_long_run_survive_the_file(tmp_path):
    starts = [1001, 4097, 999_999_999, 10**15 + 1]  # up to twelve days, to the nanosecond
    times = iter([0, *(time for start in starts for time in (start, start + 1))])
    profiler = BlockProfiler(lambda: next(times))
    for _ in starts:
        with profiler.block("x"):
            pass
    profiler.save(tmp_path / "capture.json")
    assert load_capture(tmp_path / "capture.json") == [Record("x", start, 1, 0, 0) for start in starts]


@pytest.mark.feature("profiling/cpu-blocks")
def test_the_null_backend_records_nothing():
    null = NullProfiler()
    profiling.use(null)
    assert work(random.Random(SEED)) > 20
    profiling.push("a")
    profiling.pop()
    profiling.pop()  # nothing is counted, so nothing can be unbalanced
    assert null.records() == []


@pytest.mark.parametrize(
    "text", ["{}", "no json", '{"traceEvents": [{"name": "a"}]}', "[]", '{"traceEvents": 3}']
)
def test_files_that_are_no_capture(tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(UserError, match="no capture"):
        load_capture(tmp_path / "x.json")
    with pytest.raises(UserError, match="cannot be read"):
        load_capture(tmp_path / "missing.json")
    with pytest.raises(UserError, match="cannot be written"):
        BlockProfiler().save(tmp_path / "no folder" / "x.json")


@pytest.mark.feature("profiling/fps-counter")
def test_five_ticks_are_ten_frames_per_second():
    counter = FpsCounter()
    assert [counter.tick(0.1) for _ in range(5)] == [False, False, False, False, True]
    assert counter.fps == 10.0
    assert [counter.tick(0.05) for _ in range(10)] == [False] * 9 + [True]
    assert counter.fps == pytest.approx(20.0, rel=1e-12)


@pytest.mark.feature("profiling/fps-counter")
def test_skipped_frames_are_excluded():
    counter = FpsCounter()
    for rendered in (True, False, True, False, False):
        counter.tick(0.1, rendered)
    assert counter.fps == 4.0
    assert counter.tick(1.0, rendered=False) and counter.fps == 0.0


@pytest.mark.feature("profiling/fps-counter")
@pytest.mark.parametrize("window", [0.0, -0.5, float("nan")])
def test_a_window_without_time_is_rejected(window):
    with pytest.raises(ValueError, match="above 0"):
        FpsCounter(window)
