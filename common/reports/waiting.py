"""Say what a command waits for: a sentence after two seconds, and nothing about what is quick."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PATIENCE_S = 2.0

listeners: list[Callable[[str], None]] = []
"""What gets the sentences; the command line adds its own output, and a program may add a function of its own."""


@contextmanager
def told(sentence: Callable[[], str], after_s: float = PATIENCE_S) -> Iterator[None]:
    """Give `sentence()` to the listeners, from another thread, if the block takes longer than `after_s` seconds."""

    def tell() -> None:
        text = sentence()
        for listener in list(listeners):
            listener(text)

    timer = threading.Timer(after_s, tell)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
