"""What an OpenGL driver says, tied to the pass and the Python line that caused it.

With synchronous output the driver calls back inside the call that is wrong, on its thread. So Python's stack at that
moment still shows the line of the caller. The interface is that of `backends.vulkan.driver.debug`.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from backends.callers import calling_line
from backends.gl import api as gl

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Message:
    """One message of the driver."""

    severity: Severity
    id: str  # "source/type/number"
    text: str
    objects: tuple[str, ...]  # always empty: OpenGL names objects in the text, if at all
    labels: tuple[str, ...]  # labels that were open: the pass
    line: str  # "file:line" of the caller; see `calling_line`

    def __str__(self) -> str:
        """The place first, as on Vulkan."""
        where = f" in pass {' > '.join(self.labels)}" if self.labels else ""
        return f"called from {self.line}{where}: {self.severity}: {self.text}"


_SOURCES = {
    gl.GL_DEBUG_SOURCE_API: "api",
    gl.GL_DEBUG_SOURCE_WINDOW_SYSTEM: "window-system",
    gl.GL_DEBUG_SOURCE_SHADER_COMPILER: "compiler",
    gl.GL_DEBUG_SOURCE_THIRD_PARTY: "third-party",
    gl.GL_DEBUG_SOURCE_APPLICATION: "application",
    gl.GL_DEBUG_SOURCE_OTHER: "other",
}
_TYPES = {
    gl.GL_DEBUG_TYPE_ERROR: "error",
    gl.GL_DEBUG_TYPE_DEPRECATED_BEHAVIOR: "deprecated",
    gl.GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR: "undefined",
    gl.GL_DEBUG_TYPE_PORTABILITY: "portability",
    gl.GL_DEBUG_TYPE_PERFORMANCE: "performance",
    gl.GL_DEBUG_TYPE_OTHER: "other",
    gl.GL_DEBUG_TYPE_MARKER: "marker",
}

ALLOWED: tuple[tuple[str, str], ...] = (
    # Where a driver puts its buffers, and when it compiles a shader again, is its own affair; Vulkan's drivers do not
    # even tell. Times show what it costs.
    ("api/performance", ""),
    ("compiler/performance", ""),
    # A shader that does not compile raises ShaderError, with the same words and their place in the files.
    ("compiler/error", ""),
)
"""(id prefix, part of the text) of messages that are not counted, with the reason beside each."""


class DebugSink:
    """Receives every message of a context, keeps each distinct one with its count, and hands it to the callbacks.

    `messages` maps message -> count, warnings and errors alone; tests assert that it is empty. `labels` are the labels
    that are open.
    """

    def __init__(self) -> None:
        self.messages: dict[Message, int] = {}
        self.callbacks: list[Callable[[Message], None]] = []
        self.labels: list[str] = []
        self.failure: BaseException | None = None
        self._pointer = gl.ffi.callback("GLDEBUGPROC", self._receive, onerror=self._failed)

    def listen(self, fn: gl.Functions) -> None:
        """Have the current context send its messages here, notifications left out."""
        fn.glEnable(gl.GL_DEBUG_OUTPUT)
        fn.glEnable(gl.GL_DEBUG_OUTPUT_SYNCHRONOUS)
        anything = gl.GL_DONT_CARE
        quiet = gl.GL_DEBUG_SEVERITY_NOTIFICATION
        fn.glDebugMessageControl(anything, anything, quiet, 0, gl.NULL, 0)
        fn.glDebugMessageCallback(self._pointer, gl.NULL)

    def _receive(
        self, source: int, kind: int, number: int, severity: int, length: int, text: Any, user: Any
    ) -> None:
        if severity == gl.GL_DEBUG_SEVERITY_NOTIFICATION:
            return
        serious = kind in (gl.GL_DEBUG_TYPE_ERROR, gl.GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR)
        message = Message(
            "error" if serious or severity == gl.GL_DEBUG_SEVERITY_HIGH else "warning",
            f"{_SOURCES.get(source, hex(source))}/{_TYPES.get(kind, hex(kind))}/{number}",
            gl.ffi.buffer(text, length)[:].decode("utf-8", "replace").strip(),
            (),
            tuple(self.labels),
            calling_line(sys._getframe(1)),
        )
        if any(message.id.startswith(prefix) and part in message.text for prefix, part in ALLOWED):
            return
        self.messages[message] = self.messages.get(message, 0) + 1
        for callback in self.callbacks:
            callback(message)

    def _failed(self, kind: type[BaseException], error: BaseException, trace: Any) -> None:
        """An exception cannot pass through the driver's C code: keep it, and show it now."""
        self.failure = error
        traceback.print_exception(kind, error, trace)

    def report(self) -> list[str]:
        """Return one text per distinct message, with its count."""
        return [
            f"{message}" + (f" ({count} times)" if count > 1 else "")
            for message, count in self.messages.items()
        ]
