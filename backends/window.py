"""A window of the desktop: opened by GLFW for either backend, its events are collected once a frame.

GLFW works on one thread, the one that opened the window, and from the first window to the last one is open.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from backends import x11
from common.errors import UnsupportedError
from common.view.inputs import Inputs

NO_WINDOW = "No window can be opened here ({}): run with --headless to get a picture without one."

_KEY_NAMES: dict[int, str] = {}
"""GLFW's number of a key -> its name, as on a US keyboard: W A S D then lie together on every layout."""

_open = 0
"""Windows that need GLFW to stay initialised."""

_errors: list[str] = []
"""What GLFW said since the last call that asked; by itself it would print."""


def _glfw() -> Any:
    """Return the package, imported at first use: a headless run pays nothing for it."""
    try:
        import glfw
    except ImportError as error:
        raise UnsupportedError(NO_WINDOW.format(f"GLFW is missing: {error}")) from None
    if not _KEY_NAMES:
        for name, number in vars(glfw).items():
            if name.startswith("KEY_") and name not in ("KEY_UNKNOWN", "KEY_LAST"):
                _KEY_NAMES[number] = name.removeprefix("KEY_")
    return glfw


def _has_server() -> bool:
    """Whether the environment names a display at all: cheap, and silent where GLFW would not be."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _initialise(loader: int | None = None) -> None:
    """Begin to use GLFW, or raise UnsupportedError with what it says."""
    global _open
    if not _has_server():
        raise UnsupportedError(NO_WINDOW.format("neither DISPLAY nor WAYLAND_DISPLAY is set"))
    glfw = _glfw()
    if _open == 0:
        _errors.clear()
        # Before `init`, which otherwise warns by itself.
        glfw.set_error_callback(lambda code, text: _errors.append(_decoded(text)))
        if loader is not None:
            # GLFW looks for the Vulkan loader by one name; the backend has found it already, whatever its name.
            glfw.init_vulkan_loader(loader)
        if not glfw.init():
            raise UnsupportedError(NO_WINDOW.format(_said("the display does not answer")))
    _open += 1


def _finish() -> None:
    global _open
    _open -= 1
    if _open == 0:
        _glfw().terminate()


def _decoded(text: str | bytes) -> str:
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else text


def _said(otherwise: str) -> str:
    return _errors[-1].rstrip(".") if _errors else otherwise


def display_available() -> bool:
    """Whether a window could be opened here; prints nothing and leaves nothing open."""
    try:
        _initialise()
    except UnsupportedError:
        return False
    _finish()
    return True


@dataclass(frozen=True)
class Event:
    """Something the user did, for a user interface in the window.

    "move" to the pixel (x, y); "button" 0 left, 1 right, 2 middle; "scroll" by (x, y) steps; "key" with its `name`;
    "text" that was typed, in `name`; "focus" gained or lost. `down` says which of the two.
    """

    kind: Literal["move", "button", "scroll", "key", "text", "focus"]
    x: float = 0.0
    y: float = 0.0
    name: str = ""
    button: int = 0
    down: bool = False


class Listener(Protocol):
    """A user interface in a window: it hears of everything, and what it takes does not reach `inputs` or `take_keys`.

    What is let go (a key, a button) always reaches both.
    """

    def event(self, event: Event) -> None:
        """Note what the user did."""

    def takes_mouse(self, x: float, y: float) -> bool:
        """Whether a button or a step of the wheel at the pixel (x, y) is meant for the interface."""

    def takes_keys(self) -> bool:
        """Whether keys are meant for the interface, as while something is typed there."""


ALWAYS_COMMANDS = ("F1",)
"""Keys that are commands even while an interface takes the others: for what opens and closes it."""


class Window:
    """A window of (width, height) pixels, with what the user did to it since it was last asked.

    `inputs` is the state of keyboard and mouse for cameras; `take_keys` gives the keys pressed, for commands;
    `listener` is a user interface in the window, if there is one. `damaged` is set when the desktop wants the content
    again, and stays set until the renderer clears it. For "vulkan", `loader` is the address of vkGetInstanceProcAddr.
    Raises UnsupportedError where there is no display. A context manager.
    """

    def __init__(
        self,
        size: tuple[int, int],
        title: str,
        api: Literal["vulkan", "gl"] = "vulkan",
        *,
        inputs: Inputs | None = None,
        loader: int | None = None,
        hints: dict[int, int] | None = None,
    ) -> None:
        self.inputs = inputs if inputs is not None else Inputs()
        self.listener: Listener | None = None
        self.damaged = True
        self._iconified = False
        self._keys: list[str] = []
        self.handle: Any = None
        _initialise(loader)
        glfw = _glfw()
        glfw.default_window_hints()
        if api == "vulkan":
            glfw.window_hint(glfw.CLIENT_API, glfw.NO_API)
        for hint, value in (hints or {}).items():
            glfw.window_hint(hint, value)
        _errors.clear()
        self.handle = glfw.create_window(*size, title, None, None) or None
        if self.handle is None:
            _finish()
            raise UnsupportedError(NO_WINDOW.format(_said("GLFW gives no reason")))
        for listen, callback in self._callbacks(glfw):
            listen(self.handle, callback)
        self._x11 = x11.window_id(glfw, self.handle)
        x11.gone.discard(self._x11)  # servers use numbers again

    def _callbacks(self, glfw: Any) -> list[tuple[Any, Callable[..., None]]]:
        return [
            (glfw.set_key_callback, self._on_key),
            (glfw.set_mouse_button_callback, self._on_button),
            (glfw.set_cursor_pos_callback, self._on_cursor),
            (glfw.set_scroll_callback, self._on_scroll),
            (glfw.set_char_callback, self._on_text),
            (glfw.set_window_focus_callback, self._on_focus),
            (glfw.set_window_iconify_callback, self._on_iconify),
            (glfw.set_framebuffer_size_callback, self._on_resize),
            (glfw.set_window_refresh_callback, self._on_refresh),
        ]

    # --- events ---

    def _on_key(self, window: Any, key: int, scancode: int, action: int, mods: int) -> None:
        glfw, name = _glfw(), _KEY_NAMES.get(key)
        if name is None or action == glfw.REPEAT:
            return  # releases come for every key that went down, also when the window loses the focus
        pressed = action == glfw.PRESS
        self._tell(Event("key", name=name, down=pressed))
        taken = self.listener is not None and self.listener.takes_keys()
        if pressed and (not taken or name in ALWAYS_COMMANDS):
            self._keys.append(name)
        self.inputs.key(name, pressed and not taken)

    def _on_text(self, window: Any, codepoint: int) -> None:
        self._tell(Event("text", name=chr(codepoint)))

    def _on_button(self, window: Any, button: int, action: int, mods: int) -> None:
        glfw = _glfw()
        pressed = action == glfw.PRESS
        place = self._pointer()
        self._tell(Event("move", *place))  # the button may come before the way to it
        self._tell(Event("button", button=button, down=pressed))
        if button == glfw.MOUSE_BUTTON_LEFT:
            self.inputs.dragging = pressed and not self._taken(place)

    def _on_cursor(self, window: Any, x: float, y: float) -> None:
        width, height = _glfw().get_window_size(window)  # in the desktop's units, as x and y are
        self.inputs.mouse = (x / max(width, 1), y / max(height, 1))
        self._tell(Event("move", *self._pixel(x, y)))

    def _on_scroll(self, window: Any, x: float, y: float) -> None:
        self._tell(Event("scroll", x, y))
        if not self._taken(self._pointer()):
            self.inputs.scroll += y

    def _on_focus(self, window: Any, focused: int) -> None:
        self._tell(Event("focus", down=bool(focused)))

    def _tell(self, event: Event) -> None:
        if self.listener is not None:
            self.listener.event(event)

    def _taken(self, place: tuple[float, float]) -> bool:
        return self.listener is not None and self.listener.takes_mouse(*place)

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return a place in the desktop's units in pixels of the content."""
        glfw = _glfw()
        units, pixels = glfw.get_window_size(self.handle), glfw.get_framebuffer_size(self.handle)
        return x * pixels[0] / max(units[0], 1), y * pixels[1] / max(units[1], 1)

    def _pointer(self) -> tuple[float, float]:
        """Return where the pointer is now, in pixels."""
        return self._pixel(*_glfw().get_cursor_pos(self.handle))

    def _on_iconify(self, window: Any, iconified: int) -> None:
        self._iconified = bool(iconified)
        self.damaged = True

    def _on_resize(self, window: Any, width: int, height: int) -> None:
        self.damaged = True

    def _on_refresh(self, window: Any) -> None:
        self.damaged = True

    def poll(self) -> None:
        """Collect what happened since the last call.

        Raises UnsupportedError once another program has destroyed the window.
        """
        if self._x11:
            x11.listen()
        _glfw().poll_events()
        self.check()

    def wait(self, timeout: float) -> None:
        """Sleep until something happens, but at most `timeout` seconds, and collect it; raises as `poll` does."""
        _glfw().wait_events_timeout(timeout)
        self.check()

    def check(self) -> None:
        """Raise UnsupportedError if another program destroyed the window."""
        if self._x11 in x11.gone:
            raise UnsupportedError(x11.WINDOW_GONE)

    def take_keys(self) -> list[str]:
        """Return the names of the keys that went down since the last call, in order."""
        keys, self._keys = self._keys, []
        return keys

    # --- state ---

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the content in pixels; (0, 0) while some desktops have it minimised."""
        width, height = _glfw().get_framebuffer_size(self.handle)
        return int(width), int(height)

    @property
    def scale(self) -> float:
        """How many times larger than usual the desktop wants text, in pixels."""
        return float(_glfw().get_window_content_scale(self.handle)[0])

    @property
    def minimised(self) -> bool:
        """Whether there is nothing to draw to."""
        return self._iconified or 0 in self.size

    @property
    def closing(self) -> bool:
        """Whether the user, or `request_close`, asked for the end."""
        return bool(_glfw().window_should_close(self.handle))

    def request_close(self) -> None:
        """Ask for the end, as the button of the window's frame does."""
        _glfw().set_window_should_close(self.handle, True)

    def resize(self, size: tuple[int, int]) -> None:
        """Ask the desktop for another size; what becomes of that is in `size` after the next events."""
        _glfw().set_window_size(self.handle, *size)

    def set_title(self, title: str) -> None:
        """Write `title` into the window's frame."""
        _glfw().set_window_title(self.handle, title)

    def copy_text(self, text: str) -> None:
        """Put text where other programs can paste it from."""
        _glfw().set_clipboard_string(self.handle, text)

    # --- Vulkan ---

    def vulkan_extensions(self) -> list[str]:
        """Return the instance extensions that a surface here needs; raise UnsupportedError if there can be none."""
        glfw = _glfw()
        _errors.clear()
        names = glfw.get_required_instance_extensions() if glfw.vulkan_supported() else []
        if not names:
            raise UnsupportedError(NO_WINDOW.format(_said("Vulkan cannot draw to this display")))
        return [str(name) for name in names]

    def vulkan_surface(self, instance: int) -> int:
        """Return a new VkSurfaceKHR for the VkInstance at address `instance`; both are plain numbers.

        Raises UnsupportedError with the driver's reason. Destroy it before the window is closed.
        """
        import ctypes

        _errors.clear()
        surface = ctypes.c_uint64(0)
        # GLFW is called through ctypes and knows nothing of cffi: addresses cross over as numbers.
        code = _glfw().create_window_surface(
            ctypes.c_void_p(instance), self.handle, None, ctypes.byref(surface)
        )
        if code != 0:
            raise UnsupportedError(NO_WINDOW.format(_said(f"vkCreateSurface says {code}")))
        return surface.value

    # --- life ---

    def close(self) -> None:
        """Take the window away; a second time does nothing."""
        if self.handle is None:
            return
        _glfw().destroy_window(self.handle)
        self.handle = None
        _finish()

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
