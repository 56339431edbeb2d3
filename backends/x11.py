"""What becomes of a window when its X server dies or another program destroys it: Xlib by itself ends the process.

Xlib's two handlers (Xlib manual, section 11.8.2) print lines that no user understands and call exit(1). Ours note that
a window is gone, or end the process with a sentence, since a process cannot go on with Xlib after a broken connection.
"""

from __future__ import annotations

import ctypes
import functools
import os
import sys
from typing import Any

from common.paths import remove_unfinished

DISPLAY_GONE = "The display closed the connection, and the window with it."
WINDOW_GONE = "The window is gone: another program destroyed it."

_GONE = (3, 9)
"""BadWindow and BadDrawable, of X.h."""

gone: set[int] = set()
"""Ids of windows that the server does not know any more."""


class _ErrorEvent(ctypes.Structure):
    """XErrorEvent of Xlib.h."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("resource", ctypes.c_ulong),
        ("serial", ctypes.c_ulong),
        ("error", ctypes.c_ubyte),
        ("request", ctypes.c_ubyte),
        ("minor", ctypes.c_ubyte),
    )


_OnError = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(_ErrorEvent))
_OnBroken = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


def _note(display: Any, event: Any) -> int:
    if event.contents.error in _GONE:
        gone.add(event.contents.resource)
    return 0  # Xlib ignores it, and goes on


def _end(display: Any) -> int:
    remove_unfinished()
    os.write(2, f"strata: {DISPLAY_GONE}\n".encode())
    os._exit(2)


_HANDLERS = (_OnError(_note), _OnBroken(_end))  # kept: Xlib calls them for as long as the process lives


@functools.cache
def _xlib() -> Any:
    try:
        xlib = ctypes.CDLL("libX11.so.6") if sys.platform.startswith("linux") else None
    except OSError:
        return None
    if xlib is not None:
        xlib.XSetErrorHandler.restype = xlib.XSetIOErrorHandler.restype = ctypes.c_void_p
    return xlib


def listen() -> None:
    """Take over Xlib's handlers, where there is an Xlib: again and again, since GLFW and others set their own."""
    xlib = _xlib()
    if xlib is not None:
        xlib.XSetErrorHandler(_HANDLERS[0])
        xlib.XSetIOErrorHandler(_HANDLERS[1])


def window_id(glfw: Any, handle: Any) -> int:
    """Return the X server's number of a GLFW window, or 0 for a window of another kind."""
    if not sys.platform.startswith("linux") or glfw.get_platform() != glfw.PLATFORM_X11:
        return 0
    return int(glfw.get_x11_window(handle))
