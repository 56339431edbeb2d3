"""Turns of Python's threads while textures are decoded beside frames: short meanwhile, and as before afterwards."""

from __future__ import annotations

import sys
import threading
import time

import pytest

from chapters.ch03.loading.loading import Loading, Wanted
from chapters.ch03.tasks.switching import INTERVAL_S, QuickTurns
from tests.ch03.test_loading import upload
from tests.support.timing import PATIENCE_S, least_time, timed

pytestmark = pytest.mark.usefixtures("no_thread_left")


@pytest.fixture(autouse=True)
def usual():
    """Python's own interval, before and after: no test may leave another one."""
    assert sys.getswitchinterval() == pytest.approx(0.005)
    yield
    assert sys.getswitchinterval() == pytest.approx(0.005)


def loading(streams, gate):
    made = Loading(1, streams)
    made.want({0: Wanted("image 0", 4, lambda: (gate.wait(PATIENCE_S), upload())[1])})
    made.feed()
    return made


@pytest.mark.parametrize("streams", [True, False])
def test_turns_are_short_while_there_are_threads_beside_frames(streams):
    gate = threading.Event()
    made = loading(streams, gate)
    try:
        assert sys.getswitchinterval() == pytest.approx(INTERVAL_S if streams else 0.005)
        gate.set()
        while made.decoding:
            time.sleep(0.001)
        made.rest()
        assert sys.getswitchinterval() == pytest.approx(0.005)
    finally:
        gate.set()
        made.close()


def test_the_last_of_several_renderers_puts_back_what_was_there():
    gate = threading.Event()
    one, other = loading(True, gate), loading(True, gate)
    gate.set()
    try:
        one.close()
        assert sys.getswitchinterval() == pytest.approx(INTERVAL_S)
        one.close()  # a second time does nothing
        assert sys.getswitchinterval() == pytest.approx(INTERVAL_S)
    finally:
        one.close()
        other.close()


def test_an_interval_that_is_shorter_already_stays():
    sys.setswitchinterval(INTERVAL_S / 2)
    try:
        turns = QuickTurns()
        turns.begin()
        assert sys.getswitchinterval() == pytest.approx(INTERVAL_S / 2, abs=2e-6)
        turns.end()
        assert sys.getswitchinterval() == pytest.approx(INTERVAL_S / 2, abs=2e-6)
    finally:
        sys.setswitchinterval(0.005)


@pytest.mark.alone
def test_calls_that_let_go_of_the_interpreter_have_it_back_soon():
    over = threading.Event()

    def decode():
        while not over.is_set():
            sum(range(1000))
        return upload()

    made = Loading(1, streams=True)
    made.want({0: Wanted("image 0", 4, decode)})
    made.feed()
    try:
        # As a submission does it.
        call = timed(lambda: time.sleep(5e-5), calls=20, clock=time.perf_counter)
        assert least_time(call, 0.005 / 2) < 0.005 / 2
    finally:
        over.set()
        made.close()
