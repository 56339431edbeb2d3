"""The task scheduler: every index once, every order kept, waits that help and never hang, and threads with an index."""

from __future__ import annotations

import gc
import random
import threading
import time
import weakref
from collections import Counter, defaultdict
from itertools import pairwise

import pytest

from chapters.ch03.tasks.graph import TaskGraph
from chapters.ch03.tasks.scheduler import Scheduler, split
from tests.support.threads import within
from tests.support.timing import PATIENCE_S

pytestmark = pytest.mark.usefixtures("no_thread_left")
scheduler = pytest.mark.feature("tasks/scheduler")
pinned = pytest.mark.feature("tasks/pinned-io-thread")

WORKERS = range(5)
"""What hangs is given up after this; nothing here takes a tenth of it."""


# --- ranges -----------------------------------------------------------------------------------------------------------


@scheduler
def test_parts_are_all_of_a_range_and_differ_by_one_at_most():
    for count in range(40):
        for parts in range(1, 12):
            ranges = split(count, parts)
            assert [i for first, last in ranges for i in range(first, last)] == list(range(count))
            lengths = [last - first for first, last in ranges]
            assert len(ranges) == min(parts, count)
            assert not lengths or (min(lengths) >= 1 and max(lengths) - min(lengths) <= 1)
    for count, parts in ((-1, 1), (3, 0)):
        with pytest.raises(ValueError, match="there must be"):
            split(count, parts)


@scheduler
@pytest.mark.parametrize("workers", WORKERS)
def test_a_range_covers_each_index_once_in_any_partition(workers):
    rng = random.Random(workers)
    with Scheduler(workers) as tasks:
        for _ in range(25):
            count, parts = (
                rng.choice([0, 1, 2, rng.randrange(500)]),
                rng.choice([None, 1, rng.randint(1, 60)]),
            )
            sums = [0] * tasks.threads  # without a lock: each thread has its own
            seen = Counter()

            def add(first, last, thread, sums=sums, seen=seen):
                sums[thread] += sum(range(first, last))
                seen.update({first: last - first})

            tasks.wait(tasks.spawn_range("add", add, count, parts=parts))
            assert sum(sums) == count * (count - 1) // 2
            assert sum(seen.values()) == count


@scheduler
def test_an_index_of_a_thread_is_in_use_once_at_a_time_and_always_the_same_thread():
    with Scheduler(3) as tasks:
        busy = [threading.Lock() for _ in range(tasks.threads)]
        threads, all_here = defaultdict(set), threading.Barrier(4)

        def hold(first, last, thread):
            assert busy[thread].acquire(blocking=False), f"two threads have the index {thread}"
            begins = not threads[thread]
            threads[thread].add(threading.get_ident())
            assert tasks.thread == thread
            if begins:
                all_here.wait(PATIENCE_S)
            time.sleep(0.002)
            busy[thread].release()

        tasks.wait(tasks.spawn_range("hold", hold, 40, parts=40))
        assert sorted(threads) == [0, 1, 2, 3]
        assert all(len(idents) == 1 for idents in threads.values())
        assert threads[0] == {threading.get_ident()}


# --- order ------------------------------------------------------------------------------------------------------------


def random_graph(rng, note):
    """A graph of tasks and ranges that note when they begin and end, and its edges; its steps are in any order."""
    names = [f"t{number}" for number in range(rng.randint(1, 12))]
    edges = {(a, b) for i, b in enumerate(names) for a in names[:i] if rng.random() < 0.3}
    graph = TaskGraph("random")
    for name in rng.sample(names, len(names)):
        after = [a for a, b in edges if b == name]
        if rng.random() < 0.3:
            graph.add_range(
                name,
                lambda first, last, thread, name=name: [note(name) for _ in range(first, last)],
                rng.randint(0, 4),
                parts=rng.randint(1, 4),
                after=after,
            )
        else:
            pin = rng.choice([None, None, "io"])
            graph.add(name, lambda name=name: note(name), after=after, pin=pin, priority=rng.randint(0, 2))
    return graph, edges


def reachable(edges):
    """All (a, b) such that a path leads from a to b, by brute force."""
    paths = set(edges)
    while longer := {(a, d) for a, b in paths for c, d in edges if b == c} - paths:
        paths |= longer
    return paths


@scheduler
@pytest.mark.parametrize("workers", WORKERS)
def test_whatever_comes_after_another_begins_when_that_has_ended(workers):
    for seed in range(60):
        rng = random.Random(1000 * workers + seed)
        spans = defaultdict(list)

        def note(name, rng=rng, spans=spans):
            start = time.perf_counter_ns()
            time.sleep(rng.choice([0, 0, 1e-4]))
            spans[name].append((start, time.perf_counter_ns()))
            return name

        graph, edges = random_graph(rng, note)
        with Scheduler(workers, pinned=["io"]) as tasks:
            results = tasks.run(graph)
        assert results.keys() == graph.steps.keys()
        assert all(result in (name, None) for name, result in results.items())
        for before, after in reachable(edges):
            ends = [end for _, end in spans[before]]
            starts = [start for start, _ in spans[after]]
            assert max(ends, default=0) <= min(starts, default=2**63), (seed, before, after)
        plain = [name for name, step in graph.steps.items() if not step.note.startswith("0 to")]
        assert all(len(spans[name]) == 1 for name in plain)


@scheduler
def test_a_graph_is_made_once_and_run_as_often_as_one_likes():
    runs = []
    graph = TaskGraph("frame")
    graph.add("end", lambda: runs.append("end"), after=["item"])
    graph.add_range(
        "item", lambda first, last, thread: runs.append((first, last)), 8, parts=8, after=["begin"]
    )
    graph.add("begin", lambda: runs.append("begin"))
    with Scheduler(2) as tasks:
        for _ in range(20):
            runs.clear()
            tasks.run(graph)
            assert runs[0] == "begin" and runs[-1] == "end"
            assert sorted(runs[1:-1]) == [(i, i + 1) for i in range(8)]


@scheduler
@pytest.mark.parametrize("workers", [0, 1])
def test_the_most_urgent_goes_first_then_the_oldest(workers):
    ran, order = [], [3, 0, 1, 3, 0, 2]
    go, all_ran = threading.Event(), threading.Event()

    def run(number):
        ran.append(number)
        if len(ran) == len(order):
            all_ran.set()

    with Scheduler(workers) as tasks:
        if not workers:
            go.set()
        gate = tasks.spawn("gate", lambda: go.wait(PATIENCE_S))
        made = [
            tasks.spawn(f"t{i}", lambda i=i: run(i), after=[gate], priority=priority)
            for i, priority in enumerate(order)
        ]
        go.set()
        if workers:  # not `wait`, which would help: one thread runs all
            all_ran.wait(PATIENCE_S)
        tasks.wait(tasks.join("all", made))
    assert ran == sorted(range(6), key=lambda i: (-order[i], i))


@scheduler
def test_a_long_chain_ends_without_a_deep_stack_and_is_forgotten():
    class Held:
        def __call__(self):
            return 1

    held = Held()
    alive = weakref.ref(held)
    with Scheduler(1) as tasks:
        first = last = tasks.spawn("first", held)
        oldest = weakref.ref(first)
        for number in range(3000):
            last = tasks.spawn(f"t{number}", lambda: None, after=[last])
        tasks.wait(last)
        del held
        gc.collect()
        assert alive() is None, "a task that has ended keeps what it was made of"
        assert first.result == 1
        del first
        gc.collect()
        assert oldest() is None, "the last task of a chain keeps the first"


# --- waiting ----------------------------------------------------------------------------------------------------------


@scheduler
@pytest.mark.parametrize("workers", WORKERS)
def test_spawning_and_waiting_may_be_nested(workers):
    def tree():
        with Scheduler(workers) as tasks:

            def count(depth):
                if depth == 0:
                    return 1
                parts = [tasks.spawn(f"d{depth}", lambda: count(depth - 1)) for _ in range(2)]
                inner = []
                tasks.wait(tasks.spawn_range("inner", lambda a, b, _: inner.extend(range(a, b)), 3))
                assert sorted(inner) == [0, 1, 2]
                return sum(tasks.wait(part) for part in parts)

            return tasks.wait(tasks.spawn("root", lambda: count(6)))

    assert within(PATIENCE_S, tree) == 64


@scheduler
def test_who_waits_runs_what_it_waits_for_and_nothing_else():
    def run():
        with Scheduler(1) as tasks:
            go, begun = threading.Event(), threading.Event()
            ran = {}
            blocker = tasks.spawn("blocker", lambda: (begun.set(), go.wait(PATIENCE_S)))
            begun.wait(PATIENCE_S)  # the only worker is busy from now on
            other = tasks.spawn("other", lambda: ran.setdefault("other", tasks.thread))

            def spawns():
                tasks.spawn("late", lambda: ran.setdefault("late", tasks.thread), priority=1)
                ran["first"] = tasks.thread

            first = tasks.spawn("first", spawns)
            mine = tasks.spawn("mine", lambda: ran.setdefault("mine", tasks.thread), after=[first])
            assert tasks.wait(mine) == 0
            assert ran == {"first": 0, "mine": 0}
            go.set()
            tasks.wait(tasks.join("all", [blocker, other]))

    within(PATIENCE_S, run)


@scheduler
def test_who_waits_helps_with_what_the_running_task_spawns():
    def run():
        with Scheduler(1) as tasks:
            both, begun = threading.Barrier(2), threading.Event()

            def outer():
                begun.set()
                time.sleep(0.01)  # so that the other thread waits already
                inner = tasks.spawn_range("inner", lambda *_: both.wait(PATIENCE_S / 2), 2, parts=2)
                tasks.wait(inner)  # passes only when two threads are in it at once

            task = tasks.spawn("outer", outer)
            begun.wait(PATIENCE_S)
            tasks.wait(task)

    within(PATIENCE_S, run)


@scheduler
@pytest.mark.parametrize("workers", [0, 2])
def test_a_wait_that_would_never_end_is_refused_with_the_path(workers):
    def run():
        with Scheduler(workers) as tasks:
            made = {}
            a = tasks.spawn(
                "a", lambda: tasks.wait(made["c"]), after=[tasks.spawn("begin", lambda: go.wait(PATIENCE_S))]
            )
            made["b"] = tasks.spawn("b", lambda: None, after=[a])
            made["c"] = tasks.spawn("c", lambda: None, after=[made["b"]])
            go.set()
            with pytest.raises(Exception, match="each comes before the next in a -> b -> c -> a"):
                tasks.wait(a)

    go = threading.Event()
    if not workers:
        go.set()
    within(PATIENCE_S, run)


@scheduler
def test_of_two_tasks_that_wait_for_each_other_one_is_refused():
    def run():
        with Scheduler(2) as tasks:
            both = threading.Barrier(2)
            made = {}

            def wait_for(name):
                both.wait(PATIENCE_S)
                tasks.wait(made[name])

            hold = threading.Event()
            start = tasks.spawn("start", lambda: hold.wait(PATIENCE_S))
            made["a"] = tasks.spawn("a", lambda: wait_for("b"), after=[start])
            made["b"] = tasks.spawn("b", lambda: wait_for("a"), after=[start])
            hold.set()
            for name in "ab":
                with pytest.raises(
                    Exception, match="would never end: each comes before the next in"
                ) as caught:
                    tasks.wait(made[name])
            assert "a -> b -> a" in str(caught.value) or "b -> a -> b" in str(caught.value)

    within(PATIENCE_S, run)


@scheduler
def test_a_thread_of_somebody_else_may_spawn_but_has_no_index_and_does_not_wait():
    with Scheduler(1) as tasks:

        def foreign():
            task = tasks.spawn("spawned", lambda: 7)
            with pytest.raises(RuntimeError, match="none of the scheduler's"):
                tasks.wait(task)
            with pytest.raises(RuntimeError, match="none of the scheduler's"):
                tasks.close()
            return task

        assert tasks.wait(within(PATIENCE_S, foreign)) == 7


# --- pinned threads ---------------------------------------------------------------------------------------------------


@pinned
@pytest.mark.parametrize("workers", [0, 2])
def test_a_pinned_task_always_runs_on_its_own_thread(workers):
    def run():
        with Scheduler(workers, pinned=["io", "disk"]) as tasks:
            assert tasks.threads == 1 + workers + 2
            where = defaultdict(list)
            me = threading.get_ident()

            def note(pin):
                where[pin].append((threading.get_ident(), tasks.thread))
                if len(where[pin]) % 3 == 0:  # a pinned task that waits for another one on its own thread
                    tasks.wait(tasks.spawn("inner", lambda: note(pin), pin=pin))

            made = []
            for number in range(40):
                made.append(tasks.spawn(f"free {number}", lambda: where[None].append((0, tasks.thread))))
                pin = ("io", "disk")[number % 2]
                made.append(tasks.spawn(f"{pin} {number}", lambda pin=pin: note(pin), pin=pin))
            tasks.wait(tasks.join("all", made))
            assert len(set(where["io"])) == 1 and {index for _, index in where["io"]} == {1 + workers}
            assert len(set(where["disk"])) == 1 and {index for _, index in where["disk"]} == {2 + workers}
            assert len({me, where["io"][0][0], where["disk"][0][0]}) == 3
            assert len(where["io"]) >= 20 and len(where[None]) == 40
            assert {index for _, index in where[None]} <= {*range(1 + workers)}
            with pytest.raises(ValueError, match="'gpu': no thread is called so"):
                tasks.spawn("lost", lambda: None, pin="gpu")

    within(PATIENCE_S, run)
    for workers_, names in ((-1, []), (1, ["io", "io"])):
        with pytest.raises(ValueError, match="each name once"):
            Scheduler(workers_, names)


@pinned
def test_clearing_the_flag_ends_a_loop_and_its_thread_is_joined():
    with Scheduler(1, pinned=["io"]) as tasks:
        threads = []
        stepped = threading.Event()

        def step():
            threads.append(threading.current_thread())
            stepped.set()
            return False

        loop = tasks.loop("load", step, "io")
        loop.wake()
        assert stepped.wait(PATIENCE_S) and loop.execute and not loop.task.ended
        loop.stop()
        tasks.wait(loop.task)
        assert not loop.execute
        after = tasks.spawn("next", threading.current_thread, pin="io")
        assert tasks.wait(after) is threads[0], "the thread is free for others again"
        second = tasks.loop("load again", step, "io")
        assert second.execute
    assert not second.execute and second.task.ended, "closing stops what nobody stopped"
    assert not threads[0].is_alive()


@pinned
def test_a_loop_sleeps_until_it_is_woken_and_misses_nothing():
    with Scheduler(0, pinned=["io"]) as tasks:
        queue, taken, empty = [], [], threading.Event()

        def step():
            if not queue:
                empty.set()
                return False
            taken.append(queue.pop(0))
            return True

        loop = tasks.loop("load", step, "io")
        time.sleep(0.02)
        before = time.process_time()
        time.sleep(0.2)
        assert time.process_time() - before < 0.1, "it asks in a circle"
        assert not empty.is_set(), "it was called without being woken"
        for number in range(2000):
            queue.append(number)
            if number % 3 == 1:  # as `step` says that there is more, one call for all would do
                loop.wake()
        loop.wake()
        until = time.monotonic() + PATIENCE_S
        while len(taken) < 2000 and time.monotonic() < until:
            time.sleep(1e-3)
        assert taken == list(range(2000))


@pinned
def test_a_loop_ends_with_the_error_of_its_step():
    with Scheduler(0, pinned=["io"]) as tasks:

        def step():
            raise OSError("the disk is gone")

        loop = tasks.loop("load", step, "io")
        loop.wake()
        with pytest.raises(Exception, match="Task 'load' failed: OSError: the disk is gone"):
            tasks.wait(loop.task)
        assert not loop.execute


# --- cost and trace ---------------------------------------------------------------------------------------------------


@scheduler
def test_ten_thousand_small_tasks_cost_little_each(record_property):
    for workers in (0, 2):
        with Scheduler(workers) as tasks:
            start = time.perf_counter()
            made = [tasks.spawn("small", lambda: 1) for _ in range(10_000)]
            tasks.wait(tasks.join("all", made))
            each_us = (time.perf_counter() - start) * 1e6 / 10_000
            record_property(f"us_per_task_{workers}", round(each_us, 1))
            assert each_us < 400
            assert sum(task.result for task in made) == 10_000


@scheduler
def test_the_trace_tells_when_and_where_each_task_ran():
    with Scheduler(2, pinned=["io"], trace=True) as tasks:
        truth = {}

        def work(name, inner=None):
            start = time.perf_counter_ns()
            time.sleep(1e-3)
            if inner:
                tasks.wait(tasks.spawn(inner, lambda: work(inner)))
            truth[name] = (start, time.perf_counter_ns(), tasks.thread)

        made = [tasks.spawn(f"t{i}", lambda i=i: work(f"t{i}", f"t{i}.inner")) for i in range(12)]
        made.append(tasks.spawn("file", lambda: work("file"), pin="io"))
        tasks.wait(tasks.join("all", made))
    records = {record.name: record for record in tasks.records}
    assert len(tasks.records) == len(records) == 25 and records.keys() == truth.keys()
    earliest, latest = [], []
    for name, (start, end, thread) in truth.items():
        record = records[name]
        assert record.thread == thread
        assert record.duration_ns >= end - start > 0
        earliest.append(end - record.end_ns)
        latest.append(start - record.start_ns)
    assert max(earliest) <= min(latest), "all count from one beginning"
    for thread in range(
        tasks.threads
    ):  # a timeline can be drawn: at one depth of one thread nothing overlaps
        for depth in range(4):
            row = sorted(
                (r.start_ns, r.end_ns) for r in tasks.records if (r.thread, r.depth) == (thread, depth)
            )
            assert all(end <= start for (_, end), (start, _) in pairwise(row))
    assert Scheduler(0).records is None
