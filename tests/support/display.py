"""An X server that nobody sees, for tests of windows: screenshots of it, and events as a user would cause them."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from tests.support.timing import PATIENCE_S

SIZE = (800, 600)
VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "XDG_SESSION_TYPE")


@contextmanager
def virtual_display() -> Iterator[str]:
    """Start an X server on a free number, make it this process's display, and give its name (":7")."""
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("Xvfb is not installed: windows are tested on a display that nobody sees")
    reading, writing = os.pipe()
    screen = f"{SIZE[0]}x{SIZE[1]}x24"
    process = subprocess.Popen(
        [server, "-displayfd", str(writing), "-screen", "0", screen, "-nolisten", "tcp", "-noreset"],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    before = {name: os.environ.pop(name, None) for name in VARIABLES}
    try:
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()  # the server writes it when it is ready
        if not number:
            pytest.skip("Xvfb does not start here")
        os.environ["DISPLAY"] = f":{number}"
        yield os.environ["DISPLAY"]
    finally:
        process.terminate()
        process.wait()
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def screenshot(display: str, size: tuple[int, int]) -> np.ndarray:
    """Return the top left (width, height) pixels of the screen as (H, W, 3) uint8; windows stand there."""
    from PIL import ImageGrab

    whole = np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB"))
    return whole[: size[1], : size[0]].copy()


def seen(display: str, size: tuple[int, int], expected: Callable[[np.ndarray], bool]) -> bool:
    """Whether `expected(picture)` becomes true of the top left (width, height) pixels of the screen.

    The display takes its time: a thread of the driver and the X server's process bring a presented picture there after
    the device has finished.
    """
    deadline = time.monotonic() + PATIENCE_S
    while not expected(screenshot(display, size)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def shows(display: str, picture: np.ndarray) -> bool:
    """Whether the screen comes to show exactly `picture`, (H, W, 3) uint8, at its top left."""
    return seen(display, picture.shape[1::-1], lambda pixels: np.array_equal(pixels, picture))


# --- events, as in Xlib.h: XKeyEvent, XButtonEvent, XFocusChangeEvent, XClientMessageEvent ----------------------------

KEY_PRESS, KEY_RELEASE, BUTTON_PRESS, BUTTON_RELEASE = range(2, 6)
FOCUS_IN, FOCUS_OUT, CLIENT = 9, 10, 33
KEYCODES = {"F1": 67, "TAB": 23, "W": 25, "C": 54, "SPACE": 65, "ESCAPE": 9, "LEFT_SHIFT": 50}
"""Of the evdev keyboard that Xvfb has."""

_Long, _Int = ctypes.c_ulong, ctypes.c_int


_HEAD = (("type", _Int), ("serial", _Long), ("sent", _Int), ("display", _Long), ("window", _Long))


class _Pointed(ctypes.Structure):
    """The events of keys and buttons: `detail` is the key's code or the button's number."""

    _fields_ = (
        *_HEAD,
        *((name, _Long) for name in ("root", "subwindow", "time")),
        *((name, _Int) for name in ("x", "y", "x_root", "y_root", "state", "detail", "same_screen")),
    )


class _Client(ctypes.Structure):
    """A message of the window manager."""

    _fields_ = (*_HEAD, ("message", _Long), ("format", _Int), ("data", _Long * 5))


class _Focus(ctypes.Structure):
    """The window came to the front, or another one did."""

    _fields_ = (*_HEAD, ("mode", _Int), ("detail", _Int))


class _Event(ctypes.Union):
    _fields_ = (("pointed", _Pointed), ("client", _Client), ("focus", _Focus), ("size", ctypes.c_long * 24))


class User:
    """Somebody at keyboard and mouse of one window."""

    def __init__(self, window: Any) -> None:
        import glfw

        self._glfw, self._window = glfw, window
        self._x = ctypes.CDLL("libX11.so.6")
        self._x.XInternAtom.restype = _Long
        self._x.XInternAtom.argtypes = (ctypes.c_void_p, ctypes.c_char_p, _Int)
        self._x.XSendEvent.argtypes = (ctypes.c_void_p, _Long, _Int, ctypes.c_long, ctypes.c_void_p)
        self._x.XWarpPointer.argtypes = (ctypes.c_void_p, _Long, _Long, *[_Int] * 6)
        self._x.XSync.argtypes = (ctypes.c_void_p, _Int)
        self._display = ctypes.c_void_p(glfw.get_x11_display())
        self._id = glfw.get_x11_window(window.handle)

    def _send(self, event: _Event) -> None:
        self._x.XSendEvent(self._display, self._id, 0, 0, ctypes.byref(event))
        self._x.XSync(self._display, 0)
        self._window.poll()

    def _pointed(self, kind: int, detail: int, x: int = 0, y: int = 0) -> None:
        event = _Event()
        self._time = getattr(self, "_time", 0) + 1  # X11 drops what looks like a repetition
        event.pointed = _Pointed(
            type=kind, window=self._id, time=self._time, x=x, y=y, detail=detail, same_screen=1
        )
        self._send(event)

    def key(self, name: str, down: bool) -> None:
        """Press or release a key."""
        self._pointed(KEY_PRESS if down else KEY_RELEASE, KEYCODES[name])

    def button(self, number: int, down: bool, x: int = 0, y: int = 0) -> None:
        """Press or release a button: 1 left, 2 middle, 3 right; 4 and 5 are the wheel, up and down."""
        self._pointed(BUTTON_PRESS if down else BUTTON_RELEASE, number, x, y)

    def move(self, x: int, y: int) -> None:
        """Move the pointer to a place in the window: really, so that asking for its place gives it too."""
        self._x.XWarpPointer(self._display, 0, self._id, 0, 0, 0, 0, x, y)
        self._x.XSync(self._display, 0)
        self._window.poll()

    def focus(self, gained: bool) -> None:
        """Bring the window to the front, or another one."""
        event = _Event()
        event.focus = _Focus(type=FOCUS_IN if gained else FOCUS_OUT, window=self._id)
        self._send(event)

    def close(self) -> None:
        """Press the button in the window's frame that closes it."""
        event = _Event()
        atom = self._x.XInternAtom
        event.client = _Client(
            type=CLIENT, window=self._id, message=atom(self._display, b"WM_PROTOCOLS", 0), format=32
        )
        event.client.data[0] = atom(self._display, b"WM_DELETE_WINDOW", 0)
        self._send(event)

    def destroy(self) -> None:
        """Destroy the window, as another program may."""
        self._x.XDestroyWindow(self._display, _Long(self._id))
        self._x.XSync(self._display, 0)
