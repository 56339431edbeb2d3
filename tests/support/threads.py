"""Threads in tests: what may hang is given a limit, and nobody leaves a thread behind."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


def within(seconds: float, work: Callable[[], Any]) -> Any:
    """Return what `work` returns, from a thread of its own; fail if it takes longer than this, as a deadlock does."""
    ended: dict[str, Any] = {}

    def run() -> None:
        try:
            ended["result"] = work()
        except BaseException as error:
            ended["error"] = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    assert ended, f"nothing came back within {seconds} s"
    thread.join()
    if "error" in ended:
        raise ended["error"]
    return ended["result"]
