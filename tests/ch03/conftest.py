"""What tests of chapter 3 share."""

from __future__ import annotations

import faulthandler
import signal
import sys
import threading
from collections.abc import Iterator

import pytest

from tests.support.timing import PATIENCE_S

HANGS_S = 60
"""What takes longer never ends; a test takes a second at most."""


@pytest.fixture
def no_thread_left(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test that leaves a thread behind; fail one that hangs, tell where its threads are, and end the run.

    Threads that wait for ever would keep the process after the run's last line: then it ends with code 1 by force. So
    it does where the system has no timer that interrupts the waiting of the main thread (Windows), without that line.
    """
    before = set(threading.enumerate())

    def hangs(*_: object) -> None:
        faulthandler.dump_traceback(sys.stderr)
        request.config.add_cleanup(by_force)  # not at once: pytest takes such a timer back where a test fails
        request.session.shouldstop = f"{request.node.nodeid} hung"
        pytest.fail(f"the test did not end within {HANGS_S} s")

    def by_force() -> None:
        faulthandler.dump_traceback_later(PATIENCE_S, exit=True, file=sys.__stderr__)

    timed = hasattr(signal, "setitimer")
    if timed:
        old = signal.signal(signal.SIGALRM, hangs)
        signal.setitimer(signal.ITIMER_REAL, HANGS_S)
    else:
        faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
    yield
    if timed:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, old)
    else:
        faulthandler.cancel_dump_traceback_later()
    left = [thread for thread in threading.enumerate() if thread not in before]
    # One that has done its last work needs a moment to end; one that waits for more does not end.
    for thread in left:
        thread.join(PATIENCE_S / 3)
    assert not [thread.name for thread in left if thread.is_alive()]
