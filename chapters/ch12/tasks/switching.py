"""How soon Python's threads take turns while textures are decoded beside frames.

One thread at a time runs Python. A call into the driver releases the interpreter lock, and a decoding thread may take
it. That thread releases the lock when it calls into a decoder, or after the switch interval. The default interval is
5 ms, as long as some frames, and a frame makes many driver calls. So the interval is short while threads decode for a
renderer that draws. Decoding loses almost nothing: most of it runs in C without the lock.
"""

from __future__ import annotations

import sys
import threading

INTERVAL_S = 0.0002
"""Seconds after which a thread lets another one run that waits for the interpreter."""

_lock = threading.Lock()
_users = 0
_before = 0.0


class QuickTurns:
    """Short turns from `begin` to `end`, either of which may be called twice. Several renderers may ask for them."""

    def __init__(self) -> None:
        self._begun = False

    def begin(self) -> None:
        """Shorten the interval, unless it is shorter already."""
        global _users, _before
        with _lock:
            if self._begun:
                return
            self._begun = True
            if not _users:
                _before = sys.getswitchinterval()
                sys.setswitchinterval(min(_before, INTERVAL_S))
            _users += 1

    def end(self) -> None:
        """Restore the interval, unless another renderer needs a short one."""
        global _users
        with _lock:
            if not self._begun:
                return
            self._begun = False
            _users -= 1
            if not _users:
                sys.setswitchinterval(_before)
