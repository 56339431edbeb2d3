"""How tasks end: by an error that names them, cancelled, at a close in the midst of work, and by Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import traceback

import pytest

from chapters.ch03.tasks import order
from chapters.ch03.tasks.errors import TaskCancelledError, TaskError
from chapters.ch03.tasks.graph import TaskGraph
from chapters.ch03.tasks.scheduler import Scheduler
from chapters.ch03.tasks.state import State
from common.errors import SceneError
from common.paths import ROOT
from tests.support.threads import within
from tests.support.timing import PATIENCE_S, until

pytestmark = pytest.mark.usefixtures("no_thread_left")
scheduler = pytest.mark.feature("tasks/scheduler")


def breaks():
    raise ZeroDivisionError("nothing to divide by")


# --- errors -----------------------------------------------------------------------------------------------------------


@scheduler
@pytest.mark.parametrize("workers", [0, 2])
def test_an_error_reaches_who_waits_with_the_name_of_its_task(workers):
    with Scheduler(workers) as tasks:
        bad = tasks.spawn("bad", breaks)
        with pytest.raises(
            TaskError, match=r"^Task 'bad' failed: ZeroDivisionError: nothing to divide by\.$"
        ) as caught:
            tasks.wait(bad)
        assert bad.state is State.FAILED and caught.value.name == "bad"
        cause = caught.value.__cause__
        assert isinstance(cause, ZeroDivisionError)
        assert traceback.extract_tb(cause.__traceback__)[-1].name == "breaks"
        with pytest.raises(TaskError) as again:
            tasks.wait(bad)
        assert again.value is not caught.value and again.value.__cause__ is cause
        with pytest.raises(ValueError, match="'bad' has no result: its state is FAILED"):
            _ = bad.result


@scheduler
@pytest.mark.parametrize("workers", [0, 2])
def test_what_comes_after_a_failed_task_does_not_run_and_says_why(workers):
    ran = []
    graph = TaskGraph("frame")
    graph.add("good", lambda: ran.append("good"))
    graph.add("bad", breaks)
    graph.add("next", lambda: ran.append("next"), after=["bad", "good"])
    graph.add_range("range", lambda *_: ran.append("range"), 5, after=["next"])
    graph.add("other", lambda: ran.append("other"), after=["good"])
    with Scheduler(workers) as tasks:
        made = tasks.start(graph)
        with pytest.raises(TaskError, match=r"^Task 'range' failed in 'bad': Zero"):
            tasks.wait(made["range"])
        with pytest.raises(
            TaskError, match=r"^Task 'next' did not run, because 'bad' failed: ZeroDivision"
        ) as caught:
            tasks.wait(made["next"])
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
        assert made["next"].state is State.CANCELLED
        tasks.wait(made["other"])
        assert sorted(ran) == ["good", "other"]
        late = tasks.spawn("late", lambda: ran.append("late"), after=[made["next"]])
        with pytest.raises(TaskError, match="'late' did not run, because 'bad' failed"):
            tasks.wait(late)
        with pytest.raises(TaskError, match=r"^Task 'frame' failed in 'bad'"):
            tasks.run(graph)
    assert sorted(ran) == ["good", "good", "other", "other"]


@scheduler
def test_the_first_error_of_a_range_wins_and_the_others_are_noted():
    def run():
        both = threading.Barrier(2)
        ended = []

        def part(first, last, thread):
            both.wait(PATIENCE_S)
            if first:
                time.sleep(0.2)
                ended.append(first)
                raise OSError("second")
            raise KeyError("first")

        with Scheduler(1) as tasks:
            with pytest.raises(
                TaskError, match=r"^Task 'parts' failed in 'parts\[0:1\]': KeyError: 'first'"
            ) as caught:
                tasks.wait(tasks.spawn_range("parts", part, 2, parts=2))
            assert ended == [1], "when wait comes back, nothing of the range runs any more"
        assert isinstance(caught.value.__cause__, KeyError)
        assert caught.value.__notes__ == ["Task 'parts[1:2]' failed, too: OSError: second."]

    within(PATIENCE_S, run)


@scheduler
def test_no_part_of_a_range_begins_after_one_has_failed():
    ran = []

    def part(first, last, thread):
        ran.append(first)
        if first == 3:
            breaks()

    with Scheduler(0) as tasks:
        with pytest.raises(TaskError, match=r"'parts\[3:4\]'") as caught:
            tasks.wait(tasks.spawn_range("parts", part, 50, parts=50))
        assert not hasattr(caught.value, "__notes__")
    assert ran == [0, 1, 2, 3]


@scheduler
def test_of_many_errors_some_are_noted_and_the_rest_counted():
    with Scheduler(0) as tasks:
        bad = [tasks.spawn(f"bad {i}", breaks) for i in range(20)]
        with pytest.raises(TaskError) as caught:
            tasks.wait(tasks.join("all", bad))
    assert caught.value.name == "bad 0"
    assert len(caught.value.__notes__) == 9 and caught.value.__notes__[-1] == "So did 11 more."


@scheduler
def test_a_sentence_for_the_user_stays_one_and_keeps_its_exit_code():
    def load():
        raise SceneError("wall.gltf: images[0] is damaged: save the image again.")

    with Scheduler(1) as tasks:
        with pytest.raises(TaskError) as caught:
            tasks.wait(tasks.spawn("load", load))
        assert (
            str(caught.value) == "Task 'load' failed: wall.gltf: images[0] is damaged: save the image again."
        )
        assert caught.value.exit_code == 2
        with pytest.raises(TaskError) as caught:
            tasks.wait(tasks.spawn("bad", breaks))
        assert caught.value.exit_code == 1


@scheduler
def test_an_error_that_no_one_waited_for_is_raised_at_the_latest_by_the_close():
    def spawned(tasks, name):
        """Let a task fail whose error nobody is told of."""
        task = tasks.spawn(name, breaks)
        while not task.ended:
            time.sleep(1e-3)

    tasks = Scheduler(1)
    spawned(tasks, "a")
    spawned(tasks, "b")
    with pytest.raises(TaskError, match=r"^Task 'a' failed: Zero") as caught:
        tasks.close()
    assert [note.split(":")[0] for note in caught.value.__notes__] == ["Task 'b' failed, too"]
    tasks.close()  # told once

    with Scheduler(1) as tasks:
        spawned(tasks, "a")
        with pytest.raises(TaskError, match=r"^Task 'a' failed"):
            tasks.check()
        tasks.check()

    def fails_itself():
        with Scheduler(1) as tasks:
            spawned(tasks, "a")
            raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine") as mine:
        fails_itself()
    assert mine.value.__notes__ == ["Task 'a' failed: ZeroDivisionError: nothing to divide by."]

    with Scheduler(0) as tasks:  # a task that handles the error of another was told of it

        def handles():
            with pytest.raises(TaskError):
                tasks.wait(tasks.spawn("inner", breaks))
            return "well"

        assert tasks.wait(tasks.spawn("outer", handles)) == "well"


# --- cancelling and closing -------------------------------------------------------------------------------------------


@scheduler
def test_cancelling_reaches_what_has_not_begun():
    ran = []
    with Scheduler(1) as tasks:
        go, begun = threading.Event(), threading.Event()
        running = tasks.spawn("running", lambda: (begun.set(), go.wait(PATIENCE_S)))
        begun.wait(PATIENCE_S)
        ready = tasks.spawn("ready", lambda: ran.append("ready"))
        waiting = tasks.spawn("waiting", lambda: ran.append("waiting"), after=[running])
        after = tasks.spawn("after", lambda: ran.append("after"), after=[ready])
        parts = tasks.spawn_range("parts", lambda first, *_: ran.append(first), 4, parts=4)
        kept = tasks.spawn("kept", lambda: ran.append("kept"))
        assert not tasks.cancel(running)
        assert tasks.cancel(ready) and tasks.cancel(waiting) and tasks.cancel(parts)
        assert ready.ended and after.ended and parts.ended
        assert not waiting.ended, "it ends with what it comes after"
        go.set()
        for task, text in (
            (ready, "Task 'ready' was cancelled."),
            (after, "Task 'after' was cancelled with 'ready'."),
            (waiting, "Task 'waiting' was cancelled."),
            (parts, "Task 'parts' was cancelled."),
        ):
            with pytest.raises(TaskCancelledError) as caught:
                tasks.wait(task)
            assert str(caught.value) == text and task.state is State.CANCELLED
        tasks.wait(kept)
        assert tasks.wait(running) and not tasks.cancel(running)
    assert ran == ["kept"]


@scheduler
@pytest.mark.parametrize("workers", range(4))
def test_a_close_in_the_midst_of_work_finishes_what_runs_and_cancels_the_rest(workers):
    begun, ended = [], []

    def work(name):
        begun.append(name)
        time.sleep(0.003)
        ended.append(name)

    def run():
        with Scheduler(workers, pinned=["io"]) as tasks:
            loop = tasks.loop("loop", lambda: False, "io")
            made = [tasks.spawn(f"t{i}", lambda i=i: work(i)) for i in range(2000)]
            made.append(tasks.spawn_range("range", lambda first, *_: work(first), 10, after=made[-3:]))
            if workers:
                until(lambda: ended)
            assert not tasks.stopping
        assert tasks.stopping
        assert len(begun) == len(ended) and len(begun) < 2000
        assert bool(workers) == bool(begun)
        states = {task.state for task in made}
        assert states <= {State.DONE, State.CANCELLED} and State.CANCELLED in states
        assert sum(task.state is State.DONE for task in made) == len(ended)
        assert loop.task.ended and not loop.execute
        tasks.close()  # once more is nothing
        with pytest.raises(TaskCancelledError, match="'late' cannot begin: its scheduler is closed"):
            tasks.spawn("late", lambda: None)
        with pytest.raises(TaskCancelledError):
            tasks.wait(made[-1])

    within(PATIENCE_S, run)


@scheduler
def test_a_running_task_that_waits_for_what_a_close_cancels_ends_too():
    def run():
        told = []
        with Scheduler(1) as tasks:
            begun = threading.Event()

            def outer():
                begun.set()
                while not tasks.stopping:
                    time.sleep(1e-3)
                try:
                    tasks.spawn("too late", lambda: None)
                except TaskCancelledError as error:
                    told.append(str(error))
                    raise

            def waits():
                tasks.wait(inner)

            inner = tasks.spawn("inner", lambda: None, after=[tasks.spawn("outer", outer)])
            tasks.spawn("waits", waits)
            begun.wait(PATIENCE_S)
        assert told == ["Task 'too late' cannot begin: its scheduler is closed."]
        assert inner.state is State.CANCELLED

    within(PATIENCE_S, run)


@scheduler
def test_a_task_cannot_close_what_runs_it():
    with Scheduler(0) as tasks, pytest.raises(TaskError, match="outside of its tasks"):
        tasks.wait(tasks.spawn("closes", tasks.close))
    with Scheduler(1) as tasks:
        closes = tasks.spawn("closes", tasks.close)
        while not closes.ended:
            time.sleep(1e-3)
        with pytest.raises(TaskError, match="closed by the thread that made it"):
            tasks.wait(closes)


# --- Ctrl-C -----------------------------------------------------------------------------------------------------------


CTRL_C = """
import threading, time
from chapters.ch03.tasks.scheduler import Scheduler

ran = []
try:
    with Scheduler({workers}, pinned=["io"]) as tasks:
        tasks.loop("load", lambda: False, "io").wake()
        def work(first, last, thread):
            ran.append(first)
            time.sleep(0.05)
        many = tasks.spawn_range("many", work, 10_000, parts=10_000)
        tasks.spawn("ready", lambda: print("ready", flush=True), priority=1)
        {wait}
except KeyboardInterrupt:
    left = [thread.name for thread in threading.enumerate() if thread is not threading.main_thread()]
    print("stopped", left, len(ran), many.state.name, flush=True)
"""


@scheduler
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C of one process alone cannot be sent on Windows")
@pytest.mark.parametrize(
    ("workers", "wait"),
    [(2, "tasks.wait(many)"), (1, "tasks.wait(tasks.spawn('sleep', lambda: time.sleep(0.2), after=[many]))")],
)
def test_ctrl_c_leaves_nothing_running(workers, wait):
    code = CTRL_C.format(workers=workers, wait=wait)
    child = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout.readline() == "ready\n"
        time.sleep(0.1)
        sent = time.monotonic()
        child.send_signal(signal.SIGINT)
        said, _ = child.communicate(timeout=PATIENCE_S)
    finally:
        child.kill()
        child.wait()
    assert said.startswith("stopped [] "), said
    assert 1 <= int(said.split()[2]) < 1000 and said.split()[3] == "CANCELLED"
    assert child.returncode == 0
    assert time.monotonic() - sent < 5


ANY_TIME = """
import _thread, random, threading, time
from chapters.ch03.tasks.scheduler import Scheduler

stopped = 0
for seed in range(120):
    rng = random.Random(seed)
    pause = 2e-4 + rng.random() * 0.004
    sent = []

    def interrupt():
        until = time.perf_counter() + pause
        while time.perf_counter() < until:
            time.sleep(0)
        _thread.interrupt_main()
        sent.append(time.perf_counter())

    timer = threading.Thread(target=interrupt)
    def work():
        tasks.loop("load", lambda: False, "io")
        def tree(depth):
            for task in [tasks.spawn("t", lambda: tree(depth - 1)) for _ in range(2 if depth else 0)]:
                tasks.wait(task)
        while not sent or time.perf_counter() < sent[0] + 0.05:  # however late it comes, it meets this
            tasks.wait(tasks.spawn_range("range", lambda *_: tree(2), 3, after=[tasks.spawn("first", int)]))

    tasks = Scheduler(seed % 3, pinned=["io"])
    try:
        with tasks:
            timer.start()
            work()
    except KeyboardInterrupt:
        stopped += 1
    timer.join()
    tasks.close()  # for an interrupt between the last line of `with` and the first of its end
    assert threading.active_count() == 1, threading.enumerate()
print("stopped", stopped)
"""


@scheduler
def test_an_interrupt_at_any_time_leaves_nothing_running():
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ANY_TIME)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    # Python itself loses one that comes while it calls back for a weak reference.
    assert 110 <= int(done.stdout.split()[1]) <= 120


@scheduler
@pytest.mark.parametrize("place", ["before a task that it took has run", "before others are told of an end"])
def test_an_interrupt_between_two_steps_leaves_nobody_waiting_for_ever(place, monkeypatch):
    """A worker's task waits for `last`, which comes after `first`; the interrupt keeps `last` from ever beginning."""

    def run():
        tasks, owner, waits = Scheduler(1), threading.get_ident(), threading.Event()

        def interrupted(function):
            def wrapper(*arguments):
                if threading.get_ident() == owner:
                    raise KeyboardInterrupt
                return function(*arguments)

            return wrapper

        def outer():
            waits.set()
            tasks.wait(last)

        busy = threading.Event()
        blocker = tasks.spawn("blocker", lambda: busy.wait(PATIENCE_S))
        while blocker.state is not State.RUNNING:
            time.sleep(1e-3)
        first = tasks.spawn("first", lambda: None)
        last = tasks.spawn("last", lambda: None, after=[first])
        whole = tasks.spawn("outer", outer, priority=1)
        if place.startswith("before a task"):
            monkeypatch.setattr(tasks, "_run", interrupted(tasks._run))
        else:
            monkeypatch.setattr(order, "_inherit", interrupted(order._inherit))
        with pytest.raises(KeyboardInterrupt):
            tasks.wait(last)
        monkeypatch.undo()
        busy.set()
        waits.wait(PATIENCE_S)
        time.sleep(0.01)
        assert not last.ended and not whole.ended
        tasks.close()
        assert last.state is whole.state is State.CANCELLED

    within(PATIENCE_S, run)
