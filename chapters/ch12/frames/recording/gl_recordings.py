"""Frames as lists of OpenGL calls: a list is recorded once, and its calls are made in every frame until one changes.

OpenGL has no recordings: every call has to be made in every frame. But the calls and their arguments stay the same
while only the contents of buffers change. So passes record into a list, and a frame makes the calls of the list,
without lookups between them. The list itself sets all state that its calls depend on, since other users of the context
(a window, uploads, another renderer) change the state between frames.
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
"""Prefixes of calls that create objects: they are made at once, and every frame uses the same object."""


class CallRecorder:
    """Replaces a context's functions: it stores each call with its arguments, to be made later."""

    def __init__(self, fn: gl.Functions) -> None:
        self._fn = fn
        self.calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(self._fn, name)
        if not name.startswith("gl") or name.startswith(_AT_ONCE):
            return function
        return lambda *arguments: self.calls.append((function, arguments))

    def add(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Store a call of a function that is not OpenGL's."""
        self.calls.append((function, arguments))


class RecordedSlot(FrameSlot):
    """A frame slot with its calls; `key` identifies what they were recorded for, None if they are invalid."""

    def __init__(self, context: Context, index: int) -> None:
        super().__init__(context, index)
        self.key: Any = None
        self.calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        self.work: dict[str, int] = {}
        """The counters of the recording."""


class Recordings(Frames):
    """The ring of frame slots. `begin` returns the next slot with its recorded calls; `submit` makes them again."""

    forgotten = 0
    """How often all recordings became invalid."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.slots: list[Any] = [RecordedSlot(context, index) for index in range(SLOTS)]

    def begin(self) -> RecordedSlot:
        """Return the slot for the next frame, after the GPU has finished with it."""
        slot = super().begin()
        assert isinstance(slot, RecordedSlot)
        return slot

    @contextmanager
    def recording(self, slot: RecordedSlot, key: Any) -> Iterator[CallRecorder]:
        """Record the calls in the `with` block, valid for `key`. After an error the slot has no recording."""
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
        """Make the slot's calls and flush them to the GPU, without waiting."""
        labels = self._context.sink.labels
        open_labels = len(labels)
        try:
            for call, arguments in slot.calls:
                call(*arguments)
        except BaseException:
            while len(labels) > open_labels:
                self._context.end_label()
            raise
        super().submit(slot)

    def forget(self) -> None:
        """Invalidate the recordings of all slots: something that is recorded has changed."""
        self.forgotten += 1
        for slot in self.slots:
            slot.key = None

    def exchange(self, parked: Any = None) -> Any:
        """Return the recordings of the graph, and go on with those of another one, or with none; no frame in flight."""
        kept, self.slots = (
            self.slots,
            parked or [RecordedSlot(self._context, index) for index in range(SLOTS)],
        )
        return kept

    def discard(self, parked: Any) -> None:
        """Free what `exchange` returned; no frame is in flight."""
        for slot in parked:
            slot.close()
