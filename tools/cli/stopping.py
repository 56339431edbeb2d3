"""Ctrl-C and SIGTERM that take effect soon, also while a driver draws or an encoder packs and Python has no say.

Python runs its handler of a signal between two of its own instructions. A frame of 8192x8192 pixels on a software
driver, or its PNG, is one instruction that takes many seconds. The byte that the signal leaves in a socket is there at
once, and a thread that waits for it can end the process.
"""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from common.paths import remove_unfinished
from tools.cli.console import err, say

STOPPED = 130
"""The exit code after Ctrl-C: 128 and the signal's number, as shells have it."""

ENDED = 128 + signal.SIGTERM
"""The exit code after SIGTERM, with which clusters, containers and CI end a program."""

GRACE_S = 0.5
"""How long the program may take to end in its own way, with every object released."""


_ended: list[int] = []
"""SIGTERM, once it came."""


def stop_code() -> int:
    """Return the exit code for a KeyboardInterrupt: of SIGTERM, if it was that."""
    return ENDED if _ended else STOPPED


@contextmanager
def prompt_stop(last_words: Callable[[], str] | None = None) -> Iterator[None]:
    """End the process `GRACE_S` after Ctrl-C, if what is done inside has not ended by itself until then.

    SIGTERM raises KeyboardInterrupt inside, too, unless another handler is there. Files that were being written are
    removed; what is on the GPU goes with the process. `last_words` gives a sentence that is said before such an end, or
    "", and may keep what is worth it before. Outside of the main thread, where no signal arrives, this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    over = threading.Event()
    ours = {signal.SIGINT}
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        ours.add(signal.SIGTERM)
    threading.Thread(target=_watch, args=(reader, over, ours, last_words), daemon=True).start()
    try:
        with _raising(ours):
            yield
    finally:
        over.set()
        signal.set_wakeup_fd(before)
        writer.close()  # which ends the thread, and that closes the other end


@contextmanager
def _raising(ours: Collection[int]) -> Iterator[None]:
    """Have SIGTERM raise KeyboardInterrupt, as Ctrl-C does, if it is among `ours`: by itself it ends Python at once."""
    _ended.clear()
    if signal.SIGTERM not in ours:
        yield
        return

    def ended(number: int, frame: object) -> None:
        _ended.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, ended)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _watch(
    reader: socket.socket,
    over: threading.Event,
    ours: Collection[int],
    last_words: Callable[[], str] | None,
) -> None:
    with reader:
        while received := reader.recv(64):
            came = {number for number in received if number in ours}
            if came and not over.wait(GRACE_S):
                _end(last_words, ENDED if signal.SIGTERM in came else STOPPED)


def _end(last_words: Callable[[], str] | None, code: int) -> None:
    words = "" if last_words is None else last_words()  # it may still finish a file
    remove_unfinished()
    err.show_cursor(True)  # a progress bar hides it
    if words:
        say(words)
    say("strata: stopped.")
    os._exit(code)
