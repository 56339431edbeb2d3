"""Frames whose calls are found once and made again and again, until something in them is another one.

OpenGL records nothing: every call has to be made in every frame. But which calls those are, with which arguments, is
known while nothing but the contents of buffers changes. So passes record into a list, and a frame is that list from
its first call to its last, with nothing to look up between two of them. Everything that a call may depend on is set in
the list itself: whoever else used the context meanwhile (a window, uploads, another renderer) has left his own state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context

from ..frame import SLOTS
from ..gl import Frames, FrameSlot

_AT_ONCE = ("glCreate", "glGen", "glObjectLabel", "glNamedBufferStorage", "glTextureStorage")
"""How calls begin that make an object: it is made when it is asked for, and every frame uses the same one."""


class CallRecorder:
    """Stands in for a context's functions: each call is written down with its arguments, and made later."""

    def __init__(self, fn: gl.Functions) -> None:
        self._fn = fn
        self.calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(self._fn, name)
        if not name.startswith("gl") or name.startswith(_AT_ONCE):
            return function
        return lambda *arguments: self.calls.append((function, arguments))

    def add(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Write down a call that is none of OpenGL's."""
        self.calls.append((function, arguments))


class RecordedSlot(FrameSlot):
    """A frame in flight with its calls; `key` says what they were found for, None where they are no longer good."""

    def __init__(self, context: Context, index: int) -> None:
        super().__init__(context, index)
        self.key: Any = None
        self.calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        self.work: dict[str, int] = {}
        """What the recording counted of itself."""


class Recordings(Frames):
    """The ring of slots. `begin` gives the next one as it was recorded, `submit` makes its calls once more."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.slots: list[Any] = [RecordedSlot(context, index) for index in range(SLOTS)]

    def begin(self) -> RecordedSlot:
        """Return the slot for the next frame, once the GPU has left it."""
        slot = super().begin()
        assert isinstance(slot, RecordedSlot)
        return slot

    @contextmanager
    def recording(self, slot: RecordedSlot, key: Any) -> Iterator[CallRecorder]:
        """Write down what is called within, for this slot; it is good as long as `key` is. An error leaves nothing."""
        context, fn = self._context, self._context.fn
        slot.key = None
        recorder: Any = CallRecorder(fn)
        context.fn = recorder
        try:
            yield recorder
        finally:
            context.fn = fn
        slot.calls, slot.key = recorder.calls, key

    def submit(self, slot: Any) -> None:
        """Make the slot's calls, and send them off; nothing is waited for."""
        labels = self._context.sink.labels
        around = len(labels)
        try:
            for call, arguments in slot.calls:
                call(*arguments)
        except BaseException:
            while len(labels) > around:
                self._context.end_label()
            raise
        super().submit(slot)

    def forget(self) -> None:
        """Have all slots recorded anew before their next frame: something that is recorded is another one."""
        for slot in self.slots:
            slot.key = None
