"""What tests of chapter 3 share."""

from __future__ import annotations

import faulthandler
import threading
from collections.abc import Iterator

import pytest

from tests.support.timing import PATIENCE_S

HANGS_S = 60
"""What takes longer never ends; a test takes a second at most."""


@pytest.fixture
def no_thread_left() -> Iterator[None]:
    """Fail a test that leaves a thread behind; end the run, and tell where its threads are, if a test hangs."""
    before = set(threading.enumerate())
    faulthandler.dump_traceback_later(HANGS_S, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()
    left = [thread for thread in threading.enumerate() if thread not in before]
    # One that has done its last work needs a moment to end; one that waits for more does not end.
    for thread in left:
        thread.join(PATIENCE_S / 3)
    assert not [thread.name for thread in left if thread.is_alive()]
